//! Where a regular mesh of hexahedra gets a padding layer under its boundary: below whole faces of the polycube, those where
//! it makes angles better.
//!
//! A hexahedron at an edge of the polycube has two faces on the boundary. If the map makes the edge flat, the two lie in one
//! plane, and no position of nodes makes the hexahedron a good one; with a layer below both faces of the polycube two
//! hexahedra share the edge. But where the edge stays sharp, these two would have half of its angle each. The same goes for
//! the angles of quads at the polycube's corners: the quads of a cylinder's flat end have both their edges along its rim there,
//! unless the layer below the curved faces ends on the flat one. That a layer need not be everywhere is from Cherchi et al.,
//! *Selective Padding for Polycube-Based Hexahedral Meshing*, Computer Graphics Forum 38, 2019, where an integer program decides.

use std::collections::{BTreeMap, HashMap};
use std::f64::consts::PI;

use super::bounded_mesh::BoundedMesh;
use super::grid::HexGrid;
use super::sheets::{self, faces_of, is_reentrant, left_of};
use crate::mesh::topology::DisjointSets;
use crate::{Point, Vector};

/// What the angles may cost with a layer that is not everywhere, over what they cost with one everywhere, which leaves the repair
/// more nodes to move. For scale: 0.0015 to 0.45 for 10 CAD parts, 0.99 and more for 7 models of animals and the like, one of which had cells
/// with a least scaled Jacobian of 0.007 in place of 0.49 without the layer below 22 of its 700 quads.
const MOST_OF_COST: f64 = 0.7;

/// Faces of a polycube and cells of its grid, at most, where each step of the choice is tried: a trial lays all sheets.
const MOST_FACES: usize = 100;
const MOST_CELLS: usize = 100_000;

/// Weight of an angle of a quad at a corner of the polycube, beside the angles between quads at an edge of the grid.
const OF_CORNER: f64 = 3.0;

/// Where regular hexahedra have a padding layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct PaddingReport {
    /// Quads of the grid's boundary with a hexahedron of the layer below them.
    pub quads: usize,
    /// Quads of the grid's boundary.
    pub of: usize,
}

impl PaddingReport {
    pub(super) fn everywhere(quads: usize) -> Self {
        Self { quads, of: quads }
    }

    pub(super) fn is_everywhere(&self) -> bool {
        self.quads == self.of
    }
}

/// The hexahedra of a grid, with sheets of them below those of its faces where that makes angles better; `images` are the target's points
/// for nodes of the boundary.
pub(super) fn padded_where_needed(grid: HexGrid, images: &[Point]) -> (BoundedMesh, PaddingReport) {
    let laid = |padded: &[bool]| sheets::padded(grid.clone(), padded);
    let any = |_: &[bool]| true;
    let possible = |padded: &[bool]| laid(padded).is_some();
    let go_on = Faces::of(&grid, true);
    let step_by_step = go_on.groups <= MOST_FACES && grid.hexes.len() <= MOST_CELLS;
    // A sheet that goes on inside from a reentrant edge may cross itself or end there. Then each step of the choice is tried; and faces beside
    // reentrant edges that are padded together need no such sheet.
    let choices: [&dyn Fn() -> Vec<bool>; 3] = [
        &|| padded_quads(&grid, &go_on, images, &any),
        &|| match step_by_step {
            true => padded_quads(&grid, &go_on, images, &possible),
            false => vec![],
        },
        &|| padded_quads(&grid, &Faces::of(&grid, false), images, &any),
    ];
    for choice in choices {
        let padded = choice();
        if !padded.is_empty()
            && let Some(mesh) = laid(&padded)
        {
            let report = PaddingReport {
                quads: padded.iter().filter(|padded| **padded).count(),
                of: padded.len(),
            };
            return (mesh, report);
        }
    }
    let report = PaddingReport::everywhere(grid.quads.len());
    (sheets::padded_everywhere(grid), report)
}

/// Which quads of the grid's boundary are to be padded, so that the angles at the edges and corners of the polycube are best.
/// `is_possible` is asked for each choice of quads on the way from a layer everywhere.
fn padded_quads(grid: &HexGrid, faces: &Faces, images: &[Point], is_possible: &dyn Fn(&[bool]) -> bool) -> Vec<bool> {
    let of_quads = |padded: &[bool]| -> Vec<bool> { faces.group_of.iter().map(|&group| padded[group]).collect() };
    let is_possible = |padded: &[bool]| is_possible(&of_quads(padded));
    let angles = faces.angles(grid, images);
    let everywhere = vec![true; faces.groups];
    let mut best = everywhere.clone();
    for start in [everywhere.clone(), angles.flat_groups(faces.groups)] {
        let padded = angles.lowered(start, &is_possible);
        if is_possible(&padded) && angles.cost(&padded) < angles.cost(&best) {
            best = padded;
        }
    }
    let padded = match angles.cost(&best) < MOST_OF_COST * angles.cost(&everywhere) {
        true => best,
        false => everywhere,
    };
    of_quads(&padded)
}

/// The faces of the polycube, in groups that are padded together: each by itself, or those with a reentrant edge between them, where no
/// sheet is to go on inside.
struct Faces {
    /// The face of each quad, and its group.
    face_of: Vec<u32>,
    group_of: Vec<usize>,
    groups: usize,
    /// The quad on the left of each edge of the grid's boundary, from its first end to its second.
    left_of: BTreeMap<[u32; 2], u32>,
}

impl Faces {
    fn of(grid: &HexGrid, sheets_go_on: bool) -> Self {
        let (left_of, face_of) = (left_of(&grid.quads), faces_of(&grid.quads));
        let mut groups = DisjointSets::new(grid.quads.len());
        (0..).zip(&face_of).for_each(|(quad, &face)| groups.unite(quad, face));
        for (&[a, b], &left) in left_of.iter().filter(|_| !sheets_go_on) {
            if let Some(&right) = left_of.get(&[b, a])
                && is_reentrant(grid, left, right)
            {
                groups.unite(left, right);
            }
        }
        let mut number = HashMap::new();
        let group_of = (0..grid.quads.len() as u32).map(|quad| {
            let next = number.len();
            *number.entry(groups.find(quad)).or_insert(next)
        });
        let group_of = group_of.collect();
        Self {
            face_of,
            group_of,
            groups: number.len(),
            left_of,
        }
    }

    /// The angles at edges and corners of the polycube, as mapped.
    fn angles(&self, grid: &HexGrid, images: &[Point]) -> Angles {
        let corners = |quad: u32| grid.quads[quad as usize].nodes.map(|v| images[v as usize]);
        let normal = |quad: u32| {
            let [a, b, c, d] = corners(quad);
            (c - a).cross(&(d - b)).try_normalize(0.0).unwrap_or_else(Vector::zeros)
        };
        let mut terms = Vec::new();
        for (&[a, b], &left) in &self.left_of {
            let Some(&right) = self.left_of.get(&[b, a]) else {
                continue;
            };
            if a > b || self.face_of[left as usize] == self.face_of[right as usize] {
                continue;
            }
            let along = images[b as usize] - images[a as usize];
            let along = along.try_normalize(0.0).unwrap_or_else(Vector::zeros);
            let [one, other] = [left, right].map(normal);
            // The angle inside: 180° where the normals are equal, less where the edge is convex.
            let turn = one.cross(&other).dot(&along).atan2(one.dot(&other));
            terms.push(Term::Angle(Angle {
                radians: PI - turn,
                weight: 1.0,
                parts: if is_reentrant(grid, left, right) { 3 } else { 1 },
                is_reentrant_edge: is_reentrant(grid, left, right),
                own: None,
                beside: [left, right].map(|quad| self.group_of[quad as usize]).to_vec(),
            }));
        }
        terms.extend(self.corner_terms(grid, &corners));
        terms.extend(self.group_of.iter().map(|&group| Term::Layer(group)));
        Angles::new(terms, self.groups)
    }

    /// The angles of faces at the polycube's corners.
    fn corner_terms(&self, grid: &HexGrid, corners: &dyn Fn(u32) -> [Point; 4]) -> Vec<Term> {
        let mut at_nodes: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (quad, index) in grid.quads.iter().zip(0..) {
            quad.nodes
                .iter()
                .for_each(|v| at_nodes.entry(*v).or_default().push(index));
        }
        let mut terms = Vec::new();
        for (v, quads) in at_nodes {
            let mut faces: Vec<u32> = quads.iter().map(|&quad| self.face_of[quad as usize]).collect();
            faces.sort_unstable();
            faces.dedup();
            if faces.len() < 3 {
                continue;
            }
            for face in faces {
                let of_face = quads.iter().filter(|&&quad| self.face_of[quad as usize] == face);
                let (mut radians, mut parts, mut own, mut beside) = (0.0, 0, None, vec![]);
                for &quad in of_face {
                    let nodes = grid.quads[quad as usize].nodes;
                    let k = (0..4).find(|&k| nodes[k] == v).unwrap_or_default();
                    let at = corners(quad);
                    radians += (at[(k + 1) % 4] - at[k]).angle(&(at[(k + 3) % 4] - at[k]));
                    (parts, own) = (parts + 1, Some(self.group_of[quad as usize]));
                    let around = [[nodes[(k + 1) % 4], v], [v, nodes[(k + 3) % 4]]];
                    let across = around.iter().filter_map(|edge| self.left_of.get(edge));
                    // At reentrant edges no layer ends on this face.
                    let others = across
                        .filter(|&&other| self.face_of[other as usize] != face && !is_reentrant(grid, quad, other));
                    beside.extend(others.map(|&quad| self.group_of[quad as usize]));
                }
                terms.push(Term::Angle(Angle {
                    radians,
                    weight: OF_CORNER,
                    parts,
                    is_reentrant_edge: false,
                    own,
                    beside,
                }));
            }
            terms.push(Term::Around(self.around(grid, v, quads[0])));
        }
        terms
    }

    /// The groups of the quads around a node, in order, from one of them on.
    fn around(&self, grid: &HexGrid, v: u32, first: u32) -> Vec<usize> {
        let mut groups = Vec::new();
        let mut quad = first;
        // More quads than a manifold can have at a node of a grid.
        for _ in 0..12 {
            groups.push(self.group_of[quad as usize]);
            let nodes = grid.quads[quad as usize].nodes;
            let k = (0..4).find(|&k| nodes[k] == v).unwrap_or_default();
            match self.left_of.get(&[nodes[(k + 1) % 4], v]) {
                Some(&next) if next != first => quad = next,
                _ => break,
            }
        }
        groups
    }
}

/// What a choice of padded groups costs.
enum Term {
    Angle(Angle),
    /// The groups of the quads around a node of the grid, in order. The layer cannot pass twice through a node.
    Around(Vec<usize>),
    /// The layer below a quad of a group, so that there is none where it makes no difference.
    Layer(usize),
}

/// An angle that cells of the mesh divide: between two faces at an edge of the grid, or of one face at a corner of the
/// polycube.
struct Angle {
    radians: f64,
    weight: f64,
    /// Into how many parts the cells of the grid divide it.
    parts: usize,
    /// Whether it is that of an edge at which a sheet below one side goes on inside, and leaves the angle to the same number of cells.
    is_reentrant_edge: bool,
    /// The group of the face, if it is an angle of one face.
    own: Option<usize>,
    /// The groups of the faces beside it, one for each edge: if any of them is padded, and the face itself is not, the cells
    /// of the padding divide the angle, one for each.
    beside: Vec<usize>,
}

/// The cost of a layer that would pass twice through a node, and of one below a quad.
const IMPOSSIBLE: f64 = 1e9;
const LAYER: f64 = 1e-6;

impl Term {
    fn cost(&self, padded: &[bool]) -> f64 {
        match self {
            Self::Angle(angle) => angle.cost(padded),
            Self::Around(groups) => {
                let next = groups.iter().skip(1).chain(groups.first());
                let ends = groups.iter().zip(next).filter(|(a, b)| padded[**a] != padded[**b]);
                if ends.count() > 2 { IMPOSSIBLE } else { 0.0 }
            }
            Self::Layer(group) if padded[*group] => LAYER,
            Self::Layer(_) => 0.0,
        }
    }

    fn groups(&self) -> Vec<usize> {
        let mut groups: Vec<usize> = match self {
            Self::Angle(angle) => angle.own.iter().chain(&angle.beside).copied().collect(),
            Self::Around(groups) => groups.clone(),
            Self::Layer(group) => vec![*group],
        };
        groups.sort_unstable();
        groups.dedup();
        groups
    }
}

impl Angle {
    fn cost(&self, padded: &[bool]) -> f64 {
        let of_padding = match self.own {
            Some(own) if padded[own] => 0,
            _ => self.beside.iter().filter(|&&group| padded[group]).count(),
        };
        let is_divided = of_padding > if self.is_reentrant_edge { 1 } else { 0 };
        let parts = if is_divided { of_padding } else { self.parts };
        // 0 for a right angle, 1 for a flat one; more where it is larger still.
        let part = (self.radians / parts as f64).min(1.5 * PI);
        self.weight * (1.0 - part.sin()).powi(2)
    }
}

/// All angles.
struct Angles {
    terms: Vec<Term>,
    /// The terms of each group.
    of_group: Vec<Vec<usize>>,
}

impl Angles {
    fn new(terms: Vec<Term>, groups: usize) -> Self {
        let mut of_group = vec![vec![]; groups];
        for (index, term) in terms.iter().enumerate() {
            term.groups().into_iter().for_each(|group| of_group[group].push(index));
        }
        Self { terms, of_group }
    }

    fn cost(&self, padded: &[bool]) -> f64 {
        self.terms.iter().map(|term| term.cost(padded)).sum()
    }

    /// The groups with an edge that is better divided by padding on both sides.
    fn flat_groups(&self, groups: usize) -> Vec<bool> {
        let all = vec![true; groups];
        let none = vec![false; groups];
        let mut gains = vec![0.0; groups];
        for term in &self.terms {
            let Term::Angle(angle @ Angle { own: None, .. }) = term else {
                continue;
            };
            let gain = angle.cost(&none) - angle.cost(&all);
            angle.beside.iter().for_each(|&group| gains[group] += gain);
        }
        gains.into_iter().map(|gain| gain > 0.0).collect()
    }

    /// Changes one group after the other, as long as that lowers the cost and is possible.
    fn lowered(&self, mut padded: Vec<bool>, is_possible: &dyn Fn(&[bool]) -> bool) -> Vec<bool> {
        /// Changes below this are rounding errors.
        const LEAST: f64 = 1e-9;
        // Each change lowers the cost, so that this ends.
        loop {
            let gain = |group: usize| {
                let cost = |padded: &[bool]| -> f64 {
                    let terms = self.of_group[group].iter();
                    terms.map(|&term| self.terms[term].cost(padded)).sum()
                };
                let mut other = padded.clone();
                other[group] = !other[group];
                cost(&padded) - cost(&other)
            };
            let mut gains: Vec<(f64, usize)> = (0..padded.len()).map(|group| (gain(group), group)).collect();
            gains.retain(|(gain, _)| *gain > LEAST);
            gains.sort_by(|a, b| b.0.total_cmp(&a.0));
            let mut changed = gains.into_iter().map(|(_, group)| {
                let mut changed = padded.clone();
                changed[group] = !changed[group];
                changed
            });
            match changed.find(|changed| is_possible(changed)) {
                Some(changed) => padded = changed,
                None => return padded,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::remesh::bounded_mesh::BoundedMesh;
    use crate::remesh::planes::Polycube;
    use crate::remesh::quality::invalid_cells;

    fn grid(cubes: &[[i32; 3]], size: f64) -> HexGrid {
        let surface = shapes::polycube(cubes, 1);
        HexGrid::of(&Polycube::of(&surface).unwrap(), size)
    }

    /// Which quads are padded, if all points of the grid's boundary go where `image` says.
    fn padded(grid: &HexGrid, image: impl Fn(&Point) -> Point) -> Vec<bool> {
        let images: Vec<Point> = grid.nodes.iter().map(image).collect();
        padded_quads(grid, &Faces::of(grid, true), &images, &|_| true)
    }

    fn sides_of(grid: &HexGrid, padded: &[bool]) -> Vec<[usize; 2]> {
        let of_padded = grid.quads.iter().zip(padded).filter(|(_, padded)| **padded);
        let mut sides: Vec<[usize; 2]> = of_padded.map(|(quad, _)| [quad.axis, quad.side]).collect();
        sides.sort_unstable();
        sides.dedup();
        sides
    }

    /// Requires valid cells that fill the solid, and a closed boundary of the right nodes that faces outward.
    fn require_sound(mesh: &BoundedMesh, volume: f64) {
        assert!(invalid_cells(&mesh.cells, &mesh.nodes).cells.is_empty());
        let mut on_boundary = vec![false; mesh.nodes.len()];
        let mut beside = HashMap::new();
        for t in &mesh.boundary {
            for k in 0..3 {
                on_boundary[t[k] as usize] = true;
                assert!(beside.insert([t[k], t[(k + 1) % 3]], ()).is_none());
            }
        }
        assert!(beside.keys().all(|[a, b]| beside.contains_key(&[*b, *a])));
        assert_eq!(on_boundary, mesh.on_boundary);
        let surface = crate::mesh::SurfaceMesh::new(mesh.nodes.clone(), mesh.boundary.clone()).unwrap();
        assert!((surface.volume() - volume).abs() < 1e-12 * volume);
        let outer = crate::mesh::CellMesh::new(mesh.nodes.clone(), mesh.cells.clone(), mesh.regions.clone()).unwrap();
        let faces = crate::mesh::faces(outer.cells());
        assert_eq!(2 * crate::mesh::outer(&faces).count(), mesh.boundary.len());
    }

    /// Every choice of the six faces of a cube.
    #[test]
    fn a_layer_may_end_at_any_convex_edge() {
        for choice in 0..64_usize {
            let grid = grid(&[[0, 0, 0]], 1.0 / 3.0);
            let padded: Vec<bool> = grid
                .quads
                .iter()
                .map(|quad| choice >> (2 * quad.axis + quad.side) & 1 == 1)
                .collect();
            require_sound(&sheets::padded(grid, &padded).unwrap(), 1.0);
        }
    }

    #[test]
    fn boxes_stay_grids_and_round_solids_are_padded() {
        let cube = grid(&[[0, 0, 0]], 0.25);
        assert!(!padded(&cube, |p| *p).contains(&true));
        // A box that is turned and stretched.
        assert!(!padded(&cube, |p| Point::new(2.0 * p.x - 2.0 * p.y, p.y + 4.0 * p.x, 3.0 * p.z)).contains(&true));
        let ball = |p: &Point| Point::from((p - Point::new(0.5, 0.5, 0.5)).normalize());
        assert!(!padded(&cube, ball).contains(&false));
    }

    /// The square's sides go to a circle: the layer is below them, and ends on the flat ends.
    #[test]
    fn a_cylinder_is_padded_below_its_curved_side_alone() {
        let cube = grid(&[[0, 0, 0]], 0.125);
        let image = |p: &Point| {
            let [x, y] = [2.0 * p.x - 1.0, 2.0 * p.y - 1.0];
            // From the square to the disk.
            let scale = if x == 0.0 && y == 0.0 {
                0.0
            } else {
                x.abs().max(y.abs()) / x.hypot(y)
            };
            Point::new(x * scale, y * scale, 2.0 * p.z)
        };
        let padded = padded(&cube, image);
        assert_eq!(sides_of(&cube, &padded), [[0, 0], [0, 1], [1, 0], [1, 1]]);
        require_sound(&sheets::padded(cube, &padded).unwrap(), 1.0);
    }

    /// Every choice of the faces of an L and of a tower on a plate: where sheets go on from reentrant edges they end on the other side, or
    /// the choice is refused; with faces beside reentrant edges together it never is.
    #[test]
    fn sheets_go_on_from_reentrant_edges() {
        let l = vec![[0, 0, 0], [1, 0, 0], [0, 1, 0]];
        let mut tower: Vec<[i32; 3]> = (0..9).map(|k| [k % 3, k / 3, 0]).collect();
        tower.push([1, 1, 1]);
        for (cubes, least_possible) in [(l, 150), (tower, 250)] {
            let new_grid = || grid(&cubes, 0.5);
            let volume = cubes.len() as f64;
            let whole = new_grid();
            assert!(!padded(&whole, |p| *p).contains(&true));
            let mut possible = 0;
            let faces = Faces::of(&whole, true);
            for choice in 0..1_usize << faces.groups {
                let padded: Vec<bool> = faces.group_of.iter().map(|g| choice >> g & 1 == 1).collect();
                if let Some(mesh) = sheets::padded(new_grid(), &padded) {
                    require_sound(&mesh, volume);
                    possible += 1;
                }
            }
            assert!(possible > least_possible, "{possible}");
            let joined = Faces::of(&whole, false);
            for choice in 0..1_usize << joined.groups {
                let padded: Vec<bool> = joined.group_of.iter().map(|g| choice >> g & 1 == 1).collect();
                require_sound(&sheets::padded(new_grid(), &padded).unwrap(), volume);
            }
        }
    }

    /// A shaft on a flange, both round: each has a sheet below its side, and that of the shaft goes through the flange.
    #[test]
    fn a_shaft_on_a_flange_has_a_sheet_through_the_flange() {
        let mut cubes: Vec<[i32; 3]> = (0..9).map(|k| [k % 3, k / 3, 0]).collect();
        cubes.push([1, 1, 1]);
        let whole = grid(&cubes, 0.25);
        let round = |p: &Point| {
            let [x, y] = [p.x - 1.5, p.y - 1.5];
            let scale = if x == 0.0 && y == 0.0 {
                0.0
            } else {
                x.abs().max(y.abs()) / x.hypot(y)
            };
            Point::new(x * scale, y * scale, p.z)
        };
        let padded = padded(&whole, round);
        assert_eq!(sides_of(&whole, &padded), [[0, 0], [0, 1], [1, 0], [1, 1]]);
        let quads = padded.iter().filter(|padded| **padded).count();
        assert_eq!(quads, 4 * 48 + 4 * 16);
        let (hexes, volume) = (whole.hexes.len(), cubes.len() as f64);
        let mesh = sheets::padded(whole, &padded).unwrap();
        require_sound(&mesh, volume);
        // Those of the shaft's sheet in the flange as well.
        assert_eq!(mesh.cells.len(), hexes + quads + 4 * 16);
    }

    #[test]
    fn layers_pass_once_through_a_node() {
        let angles = Angles::new(vec![Term::Around(vec![0, 1, 2, 3])], 4);
        assert_eq!(angles.cost(&[true, true, false, false]), 0.0);
        assert_eq!(angles.cost(&[true, false, false, true]), 0.0);
        assert_eq!(angles.cost(&[true, false, true, false]), IMPOSSIBLE);
        assert!(angles.lowered(vec![true, false, true, false], &|_| true) != [true, false, true, false]);
    }
}
