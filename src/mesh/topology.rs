//! Connectivity of a surface: edges, fans, holes, orientation, components and genus.
//!
//! Only indices matter, never positions: coincident vertices are different vertices. A triangle that names a vertex
//! twice has no area whatever the positions are; it is ignored, and belongs to no component.

use super::SurfaceMesh;

/// Marks a triangle without a component, or a side without an edge.
pub const NONE: u32 = u32::MAX;

/// The connectivity of a surface. Linear in the size of the mesh, in time and memory.
///
/// Everything is listed in an order that depends on the mesh alone: edges by their vertices, components by their
/// lowest triangle.
#[derive(Debug, Clone)]
pub struct Topology<'a> {
    mesh: &'a SurfaceMesh,
    edges: Vec<[u32; 2]>,
    /// The sides of edge `e` are `sides[first_side[e]..first_side[e + 1]]`.
    first_side: Vec<u32>,
    sides: Vec<HalfEdge>,
    /// Edge of side `k` of triangle `t` at `[t][k]`.
    edge_of_side: Vec<[u32; 3]>,
}

/// A side of a triangle: from its corner `corner` to the next, `(corner + 1) % 3`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct HalfEdge {
    /// Which triangle.
    pub triangle: u32,
    /// Which corner the side starts at: 0, 1 or 2.
    pub corner: u8,
}

/// Connected components across edges.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Components {
    /// Component of each triangle, [`NONE`] for those that name a vertex twice.
    pub of_triangle: Vec<u32>,
    /// Properties of each component.
    pub shapes: Vec<ComponentShape>,
}

/// Properties of a component.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ComponentShape {
    /// Number of triangles.
    pub triangles: usize,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of edges.
    pub edges: usize,
    /// Every edge has two triangles or more.
    pub closed: bool,
    /// No edge has more than two triangles, and the triangles at a vertex form one fan.
    pub manifold: bool,
}

/// Inconsistencies of orientation, and how to remove them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Orientation {
    /// Whether to flip each triangle, so that neighbours agree; of the two ways the one that flips fewer. Triangles of
    /// a non-orientable patch are never flipped.
    pub flip: Vec<bool>,
    /// Indices of the edges between two triangles that disagree.
    pub inconsistent_edges: Vec<u32>,
    /// Index of one edge per non-orientable patch, at which orientations propagated through the patch first disagree.
    pub twisted_edges: Vec<u32>,
}

impl ComponentShape {
    /// `V - E + F`.
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.triangles as i64
    }

    /// Number of handles of a closed orientable manifold; `None` when the surface is open or not manifold, or has a
    /// characteristic that no orientable surface has. A closed surface that is not orientable but of even
    /// characteristic (a Klein bottle) is not recognised: see [`Topology::orientation`].
    pub fn genus(&self) -> Option<u64> {
        let doubled = 2 - self.euler_characteristic();
        let is_whole = doubled >= 0 && doubled % 2 == 0;
        (self.closed && self.manifold && is_whole).then_some(doubled as u64 / 2)
    }
}

impl<'a> Topology<'a> {
    /// The connectivity of `mesh`, which may have up to 10⁹ triangles.
    pub fn new(mesh: &'a SurfaceMesh) -> Self {
        let (edges, first_side, sides) = gather_edges(mesh);
        let mut edge_of_side = vec![[NONE; 3]; mesh.triangles().len()];
        for (edge, range) in first_side.windows(2).enumerate() {
            for side in &sides[range[0] as usize..range[1] as usize] {
                edge_of_side[side.triangle as usize][side.corner as usize] = edge as u32;
            }
        }
        Self {
            mesh,
            edges,
            first_side,
            sides,
            edge_of_side,
        }
    }

    /// Every edge once: its vertices, the lower first.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// The triangle sides that lie on an edge, the lowest triangle first.
    pub fn sides(&self, edge: usize) -> &[HalfEdge] {
        &self.sides[self.first_side[edge] as usize..self.first_side[edge + 1] as usize]
    }

    /// The edge of each side of a triangle; `None` when it names a vertex twice.
    pub fn edges_of_triangle(&self, triangle: usize) -> Option<[u32; 3]> {
        let edges = self.edge_of_side[triangle];
        (edges[0] != NONE).then_some(edges)
    }

    /// Whether a side runs from the lower vertex of its edge to the higher.
    pub fn runs_forward(&self, side: HalfEdge) -> bool {
        let corners = self.mesh.triangles()[side.triangle as usize];
        corners[side.corner as usize] < corners[(side.corner as usize + 1) % 3]
    }

    /// Edges with one triangle: the boundaries of the holes.
    pub fn open_edges(&self) -> Vec<[u32; 2]> {
        self.edges_where(|sides| sides == 1)
    }

    /// Edges with more than two triangles.
    pub fn non_manifold_edges(&self) -> Vec<[u32; 2]> {
        self.edges_where(|sides| sides > 2)
    }

    /// Whether there are triangles, and no edge has only one.
    pub fn is_closed(&self) -> bool {
        !self.edges.is_empty() && self.side_counts().all(|sides| sides > 1)
    }

    /// No edge has more than two triangles.
    pub fn is_edge_manifold(&self) -> bool {
        self.side_counts().all(|sides| sides <= 2)
    }

    /// Vertices whose triangles form several fans: the surface touches itself there.
    pub fn non_manifold_vertices(&self) -> Vec<u32> {
        let mut fans = self.fans();
        let mut first_fan = vec![NONE; self.mesh.vertices().len()];
        let mut pinched = vec![false; self.mesh.vertices().len()];
        for (corner, vertex) in self.proper_corners() {
            let fan = fans.find(corner);
            let first = &mut first_fan[vertex as usize];
            if *first == NONE {
                *first = fan;
            } else if *first != fan {
                pinched[vertex as usize] = true;
            }
        }
        indices_where(&pinched)
    }

    /// Vertices that no triangle names, or only triangles that name a vertex twice.
    pub fn unreferenced_vertices(&self) -> Vec<u32> {
        let mut unreferenced = vec![true; self.mesh.vertices().len()];
        for (_, vertex) in self.proper_corners() {
            unreferenced[vertex as usize] = false;
        }
        indices_where(&unreferenced)
    }

    /// The boundary of each hole: its vertices in order, opposite to the direction of the triangles, so that a fan over
    /// them closes the hole with the orientation of its surroundings.
    ///
    /// Each is a closed loop where the surface is edge-manifold; elsewhere it may be a path that ends.
    pub fn boundary_loops(&self) -> Vec<Vec<u32>> {
        let mut rim = OpenEdgeGraph::new(self);
        let mut loops = Vec::new();
        for start in 0..rim.edges.len() {
            if !rim.walked[start] {
                loops.push(rim.walk(start));
            }
        }
        loops
    }

    /// Components across edges: two balls that touch in one vertex are two.
    pub fn components(&self) -> Components {
        let mut sets = DisjointSets::new(self.mesh.triangles().len());
        for edge in 0..self.edges.len() {
            let sides = self.sides(edge);
            for side in &sides[1..] {
                sets.unite(sides[0].triangle, side.triangle);
            }
        }
        let mut of_triangle = vec![NONE; self.mesh.triangles().len()];
        let mut count = 0;
        for triangle in 0..of_triangle.len() {
            if self.edge_of_side[triangle][0] == NONE {
                continue;
            }
            // The representative of a set is its lowest triangle, which was numbered before.
            let lowest = sets.find(triangle as u32) as usize;
            of_triangle[triangle] = if lowest == triangle {
                count += 1;
                count - 1
            } else {
                of_triangle[lowest]
            };
        }
        let shapes = self.shapes_of_components(&of_triangle, count as usize);
        Components { of_triangle, shapes }
    }

    /// Which triangles to flip so that neighbours across edges with two triangles agree.
    pub fn orientation(&self) -> Orientation {
        let count = self.mesh.triangles().len();
        let mut orientation = Orientation {
            flip: vec![false; count],
            inconsistent_edges: self.inconsistent_edges(),
            twisted_edges: Vec::new(),
        };
        if orientation.inconsistent_edges.is_empty() {
            return orientation;
        }
        let mut seen = vec![false; count];
        for start in 0..count {
            if !seen[start] && self.edge_of_side[start][0] != NONE {
                self.orient_patch(start as u32, &mut seen, &mut orientation);
            }
        }
        orientation
    }

    fn side_counts(&self) -> impl Iterator<Item = u32> {
        self.first_side.windows(2).map(|range| range[1] - range[0])
    }

    fn edges_where(&self, wanted: impl Fn(u32) -> bool) -> Vec<[u32; 2]> {
        let counted = self.edges.iter().zip(self.side_counts());
        counted.filter(|&(_, sides)| wanted(sides)).map(|(&e, _)| e).collect()
    }

    /// Index `3 t + k` and vertex of the corners of all triangles but those that name a vertex twice.
    fn proper_corners(&self) -> impl Iterator<Item = (u32, u32)> {
        let triangles = self.mesh.triangles().iter().zip(&self.edge_of_side).enumerate();
        triangles
            .filter(|(_, (_, edges))| edges[0] != NONE)
            .flat_map(|(t, (corners, _))| (0..3).map(move |k| (3 * t as u32 + k, corners[k as usize])))
    }

    /// Corners joined into fans: two corners at a vertex belong together when their triangles share an edge there.
    fn fans(&self) -> DisjointSets {
        let mut fans = DisjointSets::new(3 * self.mesh.triangles().len());
        for edge in 0..self.edges.len() {
            let sides = self.sides(edge);
            for side in &sides[1..] {
                for vertex in self.edges[edge] {
                    let [first, other] = [sides[0], *side].map(|side| self.corner_of_side_at(side, vertex));
                    fans.unite(first, other);
                }
            }
        }
        fans
    }

    fn corner_of_side_at(&self, side: HalfEdge, vertex: u32) -> u32 {
        let k = side.corner as u32;
        if self.start(side) == vertex {
            3 * side.triangle + k
        } else {
            3 * side.triangle + (k + 1) % 3
        }
    }

    fn start(&self, side: HalfEdge) -> u32 {
        self.mesh.triangles()[side.triangle as usize][side.corner as usize]
    }

    fn shapes_of_components(&self, of_triangle: &[u32], count: usize) -> Vec<ComponentShape> {
        let empty = ComponentShape {
            triangles: 0,
            vertices: 0,
            edges: 0,
            closed: true,
            manifold: true,
        };
        let mut shapes = vec![empty; count];
        for &component in of_triangle.iter().filter(|&&c| c != NONE) {
            shapes[component as usize].triangles += 1;
        }
        for edge in 0..self.edges.len() {
            let sides = self.sides(edge);
            let shape = &mut shapes[of_triangle[sides[0].triangle as usize] as usize];
            shape.edges += 1;
            shape.closed &= sides.len() > 1;
            shape.manifold &= sides.len() <= 2;
        }
        self.count_vertices(of_triangle, &mut shapes);
        shapes
    }

    /// Counts the vertices of each component; one with several fans of the same component makes it non-manifold.
    fn count_vertices(&self, of_triangle: &[u32], shapes: &mut [ComponentShape]) {
        let mut fans = self.fans();
        let mut first_fan = vec![NONE; self.mesh.vertices().len()];
        // Component, vertex and fan of the corners in other fans than the first at their vertex: few, if any.
        let mut others = Vec::new();
        for (corner, vertex) in self.proper_corners() {
            let (component, fan) = (of_triangle[corner as usize / 3], fans.find(corner));
            let first = &mut first_fan[vertex as usize];
            if *first == NONE {
                *first = fan;
                shapes[component as usize].vertices += 1;
            } else if *first != fan {
                others.push((component, vertex, fan));
            }
        }
        others.sort_unstable();
        others.dedup();
        for (i, &(component, vertex, _)) in others.iter().enumerate() {
            // A fan is represented by one of its corners.
            let of_first = of_triangle[first_fan[vertex as usize] as usize / 3];
            let again = of_first == component || i > 0 && others[i - 1].0 == component && others[i - 1].1 == vertex;
            let shape = &mut shapes[component as usize];
            shape.vertices += usize::from(!again);
            shape.manifold &= !again;
        }
    }

    /// Whether two sides run along their edge in opposite directions.
    fn agree(&self, first: HalfEdge, second: HalfEdge) -> bool {
        self.start(first) != self.start(second)
    }

    fn inconsistent_edges(&self) -> Vec<u32> {
        let is_inconsistent = |&edge: &u32| match self.sides(edge as usize) {
            &[first, second] => !self.agree(first, second),
            _ => false,
        };
        (0..self.edges.len() as u32).filter(is_inconsistent).collect()
    }

    /// Breadth first from `start` over edges with two triangles.
    fn orient_patch(&self, start: u32, seen: &mut [bool], orientation: &mut Orientation) {
        let flip = &mut orientation.flip;
        let mut patch = vec![start];
        let mut twisted = None;
        seen[start as usize] = true;
        let mut next = 0;
        while let Some(&triangle) = patch.get(next) {
            next += 1;
            for edge in self.edge_of_side[triangle as usize] {
                let &[first, second] = self.sides(edge as usize) else {
                    continue;
                };
                let other = if first.triangle == triangle { second } else { first }.triangle;
                let flipped = flip[triangle as usize] == self.agree(first, second);
                if !seen[other as usize] {
                    seen[other as usize] = true;
                    flip[other as usize] = flipped;
                    patch.push(other);
                } else if flip[other as usize] != flipped && twisted.is_none() {
                    twisted = Some(edge);
                }
            }
        }
        let flips = patch.iter().filter(|&&t| flip[t as usize]).count();
        for &t in &patch {
            let t = t as usize;
            flip[t] = twisted.is_none() && (flip[t] != (2 * flips > patch.len()));
        }
        orientation.twisted_edges.extend(twisted);
    }
}

/// Edges in order of their vertices, where the sides of each begin, and the sides. Buckets by the lower vertex.
fn gather_edges(mesh: &SurfaceMesh) -> (Vec<[u32; 2]>, Vec<u32>, Vec<HalfEdge>) {
    let mut first_in_bucket = vec![0u32; mesh.vertices().len() + 1];
    for ([low, _], _) in proper_sides(mesh) {
        first_in_bucket[low as usize + 1] += 1;
    }
    for v in 0..mesh.vertices().len() {
        first_in_bucket[v + 1] += first_in_bucket[v];
    }
    let count = *first_in_bucket.last().expect("one more than vertices") as usize;
    let nothing = HalfEdge { triangle: 0, corner: 0 };
    let mut bucketed = vec![(0, nothing); count];
    let mut free = first_in_bucket.clone();
    for ([low, high], side) in proper_sides(mesh) {
        bucketed[free[low as usize] as usize] = (high, side);
        free[low as usize] += 1;
    }
    let mut edges = Vec::with_capacity(count / 2);
    let mut first_side = Vec::with_capacity(count / 2 + 1);
    for (low, range) in first_in_bucket.windows(2).enumerate() {
        let range = range[0] as usize..range[1] as usize;
        bucketed[range.clone()].sort_unstable();
        for i in range.clone() {
            if i == range.start || bucketed[i].0 != bucketed[i - 1].0 {
                edges.push([low as u32, bucketed[i].0]);
                first_side.push(i as u32);
            }
        }
    }
    first_side.push(count as u32);
    (edges, first_side, bucketed.into_iter().map(|(_, side)| side).collect())
}

/// Sides of all triangles with three different corners, with their vertices in ascending order.
fn proper_sides(mesh: &SurfaceMesh) -> impl Iterator<Item = ([u32; 2], HalfEdge)> {
    let triangles = mesh.triangles().iter().enumerate();
    triangles
        .filter(|(_, [a, b, c])| a != b && b != c && c != a)
        .flat_map(|(t, corners)| {
            [0, 1, 2].map(|k: u8| {
                let (u, v) = (corners[k as usize], corners[(k as usize + 1) % 3]);
                let triangle = t as u32;
                ([u.min(v), u.max(v)], HalfEdge { triangle, corner: k })
            })
        })
}

fn indices_where(marks: &[bool]) -> Vec<u32> {
    (0..marks.len() as u32).filter(|&i| marks[i as usize]).collect()
}

/// The open edges as a graph whose nodes are fans rather than vertices, so that at a pinched vertex the boundary loops
/// of different fans stay separate.
struct OpenEdgeGraph {
    /// Vertices at both ends, opposite to the direction of the triangle.
    edges: Vec<[u32; 2]>,
    /// Fans at both ends.
    nodes: Vec<[u32; 2]>,
    /// `(fan, edge)`, sorted.
    incidences: Vec<(u32, u32)>,
    walked: Vec<bool>,
    /// At the index in `incidences` where a fan begins, the index of the first of its edges that may still be unwalked:
    /// without it, the many open edges of a fan (the pages of a book) would be searched from the first on for each.
    next: Vec<u32>,
}

impl OpenEdgeGraph {
    fn new(topology: &Topology) -> Self {
        let mut fans = topology.fans();
        let (mut edges, mut nodes) = (Vec::new(), Vec::new());
        for edge in 0..topology.edges.len() {
            if let &[side] = topology.sides(edge) {
                let corners = topology.mesh.triangles()[side.triangle as usize];
                let along = [corners[(side.corner as usize + 1) % 3], corners[side.corner as usize]];
                edges.push(along);
                nodes.push(along.map(|v| fans.find(topology.corner_of_side_at(side, v))));
            }
        }
        let ends = nodes.iter().enumerate();
        let mut incidences: Vec<(u32, u32)> = ends.flat_map(|(e, n)| n.map(|fan| (fan, e as u32))).collect();
        incidences.sort_unstable();
        Self {
            walked: vec![false; edges.len()],
            next: (0..incidences.len() as u32).collect(),
            edges,
            nodes,
            incidences,
        }
    }

    fn walk(&mut self, start: usize) -> Vec<u32> {
        let [first, mut node] = self.nodes[start];
        let [from, mut vertex] = self.edges[start];
        let mut vertices = vec![from];
        self.walked[start] = true;
        while node != first {
            vertices.push(vertex);
            let Some(edge) = self.unwalked_edge_at(node) else {
                break;
            };
            self.walked[edge] = true;
            let end = usize::from(self.nodes[edge][0] == node);
            node = self.nodes[edge][end];
            vertex = self.edges[edge][end];
        }
        vertices
    }

    fn unwalked_edge_at(&mut self, node: u32) -> Option<usize> {
        let begin = self.incidences.partition_point(|&(fan, _)| fan < node);
        let next = self.next.get_mut(begin)?;
        loop {
            let &(fan, edge) = self.incidences.get(*next as usize)?;
            if fan != node {
                return None;
            }
            if !self.walked[edge as usize] {
                return Some(edge as usize);
            }
            *next += 1;
        }
    }
}

/// Union-find whose representatives are the lowest members, so that results do not depend on the order of unions.
pub(crate) struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    /// `count` members, each in a set of its own.
    pub(crate) fn new(count: usize) -> Self {
        Self {
            parent: (0..count as u32).collect(),
        }
    }

    /// The lowest member of the set that `member` is in.
    pub(crate) fn find(&mut self, mut member: u32) -> u32 {
        while self.parent[member as usize] != member {
            let grandparent = self.parent[self.parent[member as usize] as usize];
            self.parent[member as usize] = grandparent;
            member = grandparent;
        }
        member
    }

    /// Makes one set of the sets that `a` and `b` are in.
    pub(crate) fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests;
