use super::anatomy::{Anatomy, Shell, is_finite};
use super::{
    CheckReport, ComponentKind, ComponentReport, FindSelfIntersections, Finding, FindingKind, Severity,
    look_for_self_intersections,
};
use crate::Point;
use crate::geometry::Aabb;
use crate::mesh::topology::Topology;
use crate::mesh::{SurfaceMesh, lowest_coincident_vertices, welded};

/// How many ids a finding lists.
const LISTED: usize = 20;

/// A triangle whose height is below this fraction of its longest side counts as having no area.
const NO_HEIGHT: f64 = 1e-12;

/// Examines a surface: what it is, what is wrong with it, where, and what to do about it.
///
/// `self_intersections` finds intersecting triangles, as CGAL does in builds with the `native` feature; without it the
/// report says that they were not looked for. It gets only the triangles with finite corners and an area; the report
/// has indices into the whole surface. Takes about a second per million triangles.
pub fn check(mesh: &SurfaceMesh, self_intersections: Option<FindSelfIntersections>) -> CheckReport {
    let anatomy = Anatomy::of(mesh);
    // Only among the triangles that the finder can handle; the pairs are indices into the whole surface.
    let in_proper_part = self_intersections.map(|find| {
        move |mesh: &SurfaceMesh| {
            let (proper, original) = proper_part(mesh);
            let pair = |[a, b]: [u32; 2]| Some([*original.get(a as usize)?, *original.get(b as usize)?]);
            Ok(find(&proper)?.into_iter().filter_map(pair).collect())
        }
    });
    let (self_intersections, intersecting) = look_for_self_intersections(mesh, in_proper_part);
    let mut findings: Vec<Finding> = [
        empty(&anatomy),
        non_finite_vertices(mesh),
        open_edges(&anatomy),
        non_manifold_edges(&anatomy),
        non_orientable(&anatomy),
        crowded_components(&anatomy),
        zero_volume(&anatomy),
        inconsistent_orientation(&anatomy),
        inward(&anatomy),
        cavity_orientation(&anatomy),
        overlapping_shells(&anatomy),
        self_intersecting(&intersecting),
        non_manifold_vertices(&anatomy),
        duplicate_faces(mesh),
        repeated_corner_faces(mesh),
        degenerate_faces(mesh),
        duplicate_vertices(mesh),
        unreferenced_vertices(&anatomy),
    ]
    .into_iter()
    .flatten()
    .collect();
    findings.sort_by_key(|finding| finding.severity);
    let found = |kind| findings.iter().any(|finding: &Finding| finding.kind == kind);
    let shells = &anatomy.shells;
    let bounds_a_solid = !shells.is_empty() && shells.iter().all(Shell::has_volume);
    let finite: Vec<Point> = mesh.vertices().iter().filter(|p| is_finite(p)).copied().collect();
    let bounds = (!finite.is_empty()).then(|| Aabb::around(&finite));
    CheckReport {
        vertices: mesh.vertices().len(),
        faces: mesh.triangles().len(),
        closed: anatomy.topology.is_closed(),
        edge_manifold: anatomy.topology.is_edge_manifold(),
        vertex_manifold: !found(FindingKind::NonManifoldVertices),
        consistently_oriented: anatomy.orientation.inconsistent_edges.is_empty(),
        outward: bounds_a_solid
            && anatomy.orientation.inconsistent_edges.is_empty()
            && !shells.iter().any(Shell::faces_wrong_way),
        self_intersections,
        area: shells.iter().map(|shell| shell.area).sum(),
        volume: bounds_a_solid.then(|| shells.iter().map(signed_volume).sum()),
        bounding_box: bounds.map(|b| [b.low.into(), b.high.into()]),
        diagonal: bounds.map_or(0.0, |b| b.extent().norm()),
        components: component_reports(&anatomy),
        findings,
    }
}

/// Positive for solids, negative for cavities.
fn signed_volume(shell: &Shell) -> f64 {
    if shell.is_cavity() {
        -shell.volume.abs()
    } else {
        shell.volume.abs()
    }
}

fn component_reports(anatomy: &Anatomy) -> Vec<ComponentReport> {
    let shells = anatomy.components.shapes.iter().zip(&anatomy.shells);
    shells
        .zip(&anatomy.boxes)
        .map(|((shape, shell), bounds)| ComponentReport {
            faces: shape.triangles,
            vertices: shape.vertices,
            euler_characteristic: shape.euler_characteristic(),
            genus: shape.genus().filter(|_| shell.is_sound),
            area: shell.area,
            volume: shell.is_sound.then_some(shell.volume),
            centre: Some(nalgebra::center(&bounds.low, &bounds.high))
                .filter(is_finite)
                .map(|centre| centre.coords.into()),
            kind: match shell {
                _ if !shell.is_sound => ComponentKind::NotAShell,
                _ if shell.is_cavity() => ComponentKind::Cavity,
                _ => ComponentKind::Solid,
            },
            depth: shell.is_sound.then_some(shell.depth),
            inside: shell.inside,
        })
        .collect()
}

/// The triangles with an area and finite corners, over the vertices they name, and their indices in the whole.
fn proper_part(mesh: &SurfaceMesh) -> (SurfaceMesh, Vec<u32>) {
    let is_proper = |&t: &u32| {
        let corners = mesh.corners(t as usize);
        corners.iter().all(is_finite) && !has_no_area(&corners)
    };
    let kept: Vec<u32> = (0..mesh.triangles().len() as u32).filter(is_proper).collect();
    let mut number = vec![u32::MAX; mesh.vertices().len()];
    let mut vertices = Vec::new();
    let mut renumbered = |v: u32| {
        let number = &mut number[v as usize];
        if *number == u32::MAX {
            *number = vertices.len() as u32;
            vertices.push(mesh.vertices()[v as usize]);
        }
        *number
    };
    let triangles = kept
        .iter()
        .map(|&t| mesh.triangles()[t as usize].map(&mut renumbered))
        .collect();
    let proper = SurfaceMesh::new(vertices, triangles).expect("triangles name the vertices that were kept for them");
    (proper, kept)
}

fn has_no_area([a, b, c]: &[Point; 3]) -> bool {
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    let magnitude = [a, b, c].map(|p| p.coords.amax()).into_iter().fold(0.0, f64::max);
    // Coordinates far from the origin are rounded more coarsely than a small triangle's height.
    let no_height = NO_HEIGHT * longest + 2.0 * f64::EPSILON * magnitude;
    (b - a).cross(&(c - a)).norm() <= no_height * longest
}

fn names_a_vertex_twice(&[a, b, c]: &[u32; 3]) -> bool {
    a == b || b == c || c == a
}

fn empty(anatomy: &Anatomy) -> Option<Finding> {
    let message = match anatomy.mesh.triangles().len() {
        0 => "the surface has no triangles".to_string(),
        count => format!("none of the {count} triangles has three different corners"),
    };
    let advice = "check that the right file was exported, with its faces";
    let nothing = anatomy.components.shapes.is_empty();
    nothing.then(|| error(FindingKind::Empty, 1, message, advice))
}

fn non_finite_vertices(mesh: &SurfaceMesh) -> Option<Finding> {
    let vertices = indices(mesh.vertices().iter().map(|p| !is_finite(p)));
    let first = *vertices.first()?;
    let place = mesh.vertices()[first as usize];
    let message = format!(
        "{} an infinite or undefined coordinate, first vertex {first} at ({}, {}, {})",
        counted(vertices.len(), "vertex has", "vertices have"),
        place.x,
        place.y,
        place.z
    );
    let advice = "export the model again; a division by zero in the program that wrote it is the usual cause";
    Some(error(FindingKind::NonFiniteVertices, vertices.len(), message, advice).at_vertices(&vertices))
}

fn open_edges(anatomy: &Anatomy) -> Option<Finding> {
    let edges = anatomy.topology.open_edges();
    if edges.is_empty() {
        return None;
    }
    let loops = anatomy.topology.boundary_loops();
    let longest = loops.iter().map(Vec::len).max().unwrap_or(0);
    let message = format!(
        "{} around {}, the longest of {}",
        counted(edges.len(), "open edge", "open edges"),
        counted(loops.len(), "hole", "holes"),
        counted(longest, "edge", "edges"),
    );
    let welded = welded(anatomy.mesh);
    let left = Topology::new(&welded).open_edges().len();
    let advice = if left == 0 {
        "merge the vertices that coincide (Blender: Merge by Distance; MeshLab: Merge Close Vertices): that closes the \
         surface"
            .to_string()
    } else if left < edges.len() {
        format!(
            "merge the vertices that coincide (Blender: Merge by Distance; MeshLab: Merge Close Vertices), which \
             leaves {left} open, then fill the holes (MeshLab: Close Holes; Blender: Clean Up > Fill Holes)"
        )
    } else {
        "fill the holes (MeshLab: Close Holes; Blender: Clean Up > Fill Holes), or wrap the surface \
         (CGAL: Alpha Wrapping)"
            .to_string()
    };
    Some(error(FindingKind::OpenEdges, edges.len(), message, &advice).at_edges(&edges))
}

fn non_manifold_edges(anatomy: &Anatomy) -> Option<Finding> {
    let edges = anatomy.topology.non_manifold_edges();
    let &[first, second] = edges.first()?;
    let message = format!(
        "{} more than two triangles, first between vertices {first} and {second}",
        counted(edges.len(), "edge has", "edges have"),
    );
    let advice = "delete doubled and inner faces and split parts that touch along an edge (MeshLab: Repair Non \
                  Manifold Edges; Blender: Select Non Manifold), or wrap the surface (CGAL: Alpha Wrapping)";
    Some(error(FindingKind::NonManifoldEdges, edges.len(), message, advice).at_edges(&edges))
}

fn non_orientable(anatomy: &Anatomy) -> Option<Finding> {
    let edges = edges_of(anatomy, &anatomy.orientation.twisted_edges);
    let &[first, second] = edges.first()?;
    let message = format!(
        "{} one side only, like a Moebius strip; the twist closes at the edge between vertices {first} and {second}",
        counted(edges.len(), "part has", "parts have"),
    );
    let advice = "no solid has such a boundary: cut the part open and close it untwisted";
    Some(error(FindingKind::NonOrientable, edges.len(), message, advice).at_edges(&edges))
}

fn crowded_components(anatomy: &Anatomy) -> Option<Finding> {
    let count = anatomy.crowd?;
    let message = format!(
        "the bounding boxes of {count} closed components overlap so much that it was not determined which component \
         encloses which"
    );
    let advice = "delete duplicate components, unite those that overlap (Blender: Boolean > Union; MeshLab: Mesh \
                  Boolean), or solve on a part of them";
    Some(error(FindingKind::CrowdedComponents, count, message, advice))
}

fn zero_volume(anatomy: &Anatomy) -> Option<Finding> {
    let is_flat = |shell: &Shell| shell.is_sound && !shell.has_volume();
    let first = anatomy.shells.iter().position(is_flat)?;
    let count = anatomy.shells.iter().filter(|shell| is_flat(shell)).count();
    let faces: Vec<u32> = anatomy.triangles_where(|_, shell| is_flat(shell)).collect();
    let message = format!(
        "{} no volume, first component {first} of {}",
        counted(count, "closed component encloses", "closed components enclose"),
        counted(anatomy.components.shapes[first].triangles, "triangle", "triangles"),
    );
    let advice = "delete the flat component, or give it thickness (Blender: Solidify)";
    Some(error(FindingKind::ZeroVolume, count, message, advice).at_faces(&faces))
}

fn inconsistent_orientation(anatomy: &Anatomy) -> Option<Finding> {
    let orientation = &anatomy.orientation;
    let edges = edges_of(anatomy, &orientation.inconsistent_edges);
    if edges.is_empty() {
        return None;
    }
    let faces = indices(orientation.flip.iter().copied());
    let remedy = match faces.len() {
        0 => "no reversal of triangles would make them agree".to_string(),
        count => format!(
            "reversing {} would make them agree",
            counted(count, "triangle", "triangles")
        ),
    };
    let message = format!(
        "{} two triangles that disagree about which side is out; {remedy}",
        counted(edges.len(), "edge lies between", "edges lie between"),
    );
    let advice = "closed orientable parts are repaired before the solve; others: Blender, Recalculate Outside";
    let finding = warning(FindingKind::InconsistentOrientation, edges.len(), message, advice);
    Some(finding.at_edges(&edges).at_faces(&faces))
}

fn inward(anatomy: &Anatomy) -> Option<Finding> {
    let (count, faces) = wrong_way_round(anatomy, |shell| !shell.is_cavity())?;
    let message = format!(
        "{} inward: the volume is negative",
        counted(count, "solid component faces", "solid components face")
    );
    let advice = "nothing to do: the triangles are reversed before the solve";
    Some(warning(FindingKind::Inward, count, message, advice).at_faces(&faces))
}

fn cavity_orientation(anatomy: &Anatomy) -> Option<Finding> {
    let (count, faces) = wrong_way_round(anatomy, Shell::is_cavity)?;
    let message = format!(
        "{} like a solid: a component inside another is the boundary of a cavity and should face into it",
        counted(count, "cavity is oriented", "cavities are oriented")
    );
    let advice = "nothing to do if a cavity is meant: the triangles are reversed before the solve; if a solid \
                  inside the solid is meant, delete the component or solve on it alone";
    Some(warning(FindingKind::CavityOrientation, count, message, advice).at_faces(&faces))
}

/// Number of the shells of a kind that face the wrong way, and their triangles.
fn wrong_way_round(anatomy: &Anatomy, kind: impl Fn(&Shell) -> bool) -> Option<(usize, Vec<u32>)> {
    let wrong = |shell: &Shell| shell.faces_wrong_way() && kind(shell);
    let count = anatomy.shells.iter().filter(|shell| wrong(shell)).count();
    let faces = || anatomy.triangles_where(|_, shell| wrong(shell)).collect();
    (count > 0).then(|| (count, faces()))
}

fn overlapping_shells(anatomy: &Anatomy) -> Option<Finding> {
    let overlaps = &anatomy.overlaps;
    let &[first, second] = overlaps.first()?;
    let message = format!(
        "{} inside each other, first components {first} and {second}",
        counted(
            overlaps.len(),
            "pair of components is partly",
            "pairs of components are partly"
        ),
    );
    let advice = "unite the parts (Blender: Boolean > Union; MeshLab: Mesh Boolean); as it is, the overlap belongs to \
                  both of them";
    Some(warning(FindingKind::OverlappingShells, overlaps.len(), message, advice))
}

fn self_intersecting(pairs: &[[u32; 2]]) -> Option<Finding> {
    let &[first, second] = pairs.first()?;
    let mut faces = pairs.concat();
    faces.sort_unstable();
    faces.dedup();
    let message = format!(
        "{} intersect, first {first} and {second}; {} take part",
        counted(pairs.len(), "pair of triangles", "pairs of triangles"),
        counted(faces.len(), "triangle", "triangles"),
    );
    let advice = "a map can be fitted, but inside and outside are ambiguous there and the solid cannot be \
                  tetrahedralised: smooth or remesh around these triangles, or wrap the surface (CGAL: Alpha Wrapping)";
    Some(warning(FindingKind::SelfIntersections, pairs.len(), message, advice).at_faces(&faces))
}

fn non_manifold_vertices(anatomy: &Anatomy) -> Option<Finding> {
    let vertices = anatomy.topology.non_manifold_vertices();
    let message = format!(
        "the surface touches itself at {}, first {}",
        counted(vertices.len(), "vertex", "vertices"),
        vertices.first()?
    );
    let advice = "a map can be fitted; the parts that touch share one image there. To separate them, give each its own \
                  vertex (MeshLab: Repair Non Manifold Vertices by Splitting)";
    Some(warning(FindingKind::NonManifoldVertices, vertices.len(), message, advice).at_vertices(&vertices))
}

fn duplicate_faces(mesh: &SurfaceMesh) -> Option<Finding> {
    let sorted = |t: &[u32; 3]| {
        let mut corners = *t;
        corners.sort_unstable();
        corners
    };
    let mut keyed: Vec<([u32; 3], u32)> = (0..).zip(mesh.triangles()).map(|(i, t)| (sorted(t), i)).collect();
    keyed.sort_unstable();
    let again = |pair: &[([u32; 3], u32)]| (pair[0].0 == pair[1].0).then_some(pair[1].1);
    let mut faces: Vec<u32> = keyed.windows(2).filter_map(again).collect();
    faces.sort_unstable();
    let message = format!(
        "{} the vertices of an earlier one, first triangle {}",
        counted(faces.len(), "triangle has", "triangles have"),
        faces.first()?
    );
    let advice = "delete them (MeshLab: Remove Duplicate Faces); where a face occurs in both orientations, delete both";
    Some(warning(FindingKind::DuplicateFaces, faces.len(), message, advice).at_faces(&faces))
}

fn repeated_corner_faces(mesh: &SurfaceMesh) -> Option<Finding> {
    let faces = indices(mesh.triangles().iter().map(names_a_vertex_twice));
    let message = format!(
        "{} a vertex twice, first triangle {}",
        counted(faces.len(), "triangle names", "triangles name"),
        faces.first()?
    );
    let advice = "nothing to do: they have no area and are ignored";
    Some(warning(FindingKind::RepeatedCornerFaces, faces.len(), message, advice).at_faces(&faces))
}

fn degenerate_faces(mesh: &SurfaceMesh) -> Option<Finding> {
    let is_degenerate = |t: usize| {
        let corners = mesh.corners(t);
        corners.iter().all(is_finite) && !names_a_vertex_twice(&mesh.triangles()[t]) && has_no_area(&corners)
    };
    let faces = indices((0..mesh.triangles().len()).map(is_degenerate));
    let message = format!(
        "{} no area, first triangle {}",
        counted(faces.len(), "triangle has", "triangles have"),
        faces.first()?
    );
    let advice = "a map can be fitted, no sample falls on them; before tetrahedralising, collapse them (Blender: \
                  Degenerate Dissolve) or remesh";
    Some(warning(FindingKind::DegenerateFaces, faces.len(), message, advice).at_faces(&faces))
}

fn duplicate_vertices(mesh: &SurfaceMesh) -> Option<Finding> {
    let lowest = lowest_coincident_vertices(mesh.vertices());
    let vertices = indices((0..).zip(&lowest).map(|(v, &lowest)| v != lowest));
    let first = *vertices.first()?;
    let message = format!(
        "{} at the place of an earlier one, first vertex {first} with {}",
        counted(vertices.len(), "vertex is", "vertices are"),
        lowest[first as usize]
    );
    let advice = "nothing to do where the surface is closed; merging them (Blender: Merge by Distance) renumbers the \
                  vertices, so do it to domain and image alike";
    Some(warning(FindingKind::DuplicateVertices, vertices.len(), message, advice).at_vertices(&vertices))
}

fn unreferenced_vertices(anatomy: &Anatomy) -> Option<Finding> {
    let vertices = anatomy.topology.unreferenced_vertices();
    let message = format!(
        "{}, first vertex {}",
        counted(
            vertices.len(),
            "vertex belongs to no triangle",
            "vertices belong to no triangle"
        ),
        vertices.first()?
    );
    let advice = "nothing to do: they are ignored. MeshLab (Remove Unreferenced Vertices) removes them, which \
                  renumbers the others";
    Some(warning(FindingKind::UnreferencedVertices, vertices.len(), message, advice).at_vertices(&vertices))
}

fn error(kind: FindingKind, count: usize, message: String, advice: &str) -> Finding {
    Finding {
        kind,
        severity: Severity::Error,
        count,
        vertices: Vec::new(),
        edges: Vec::new(),
        faces: Vec::new(),
        message,
        advice: advice.to_string(),
    }
}

fn warning(kind: FindingKind, count: usize, message: String, advice: &str) -> Finding {
    Finding {
        severity: Severity::Warning,
        ..error(kind, count, message, advice)
    }
}

impl Finding {
    fn at_vertices(mut self, vertices: &[u32]) -> Self {
        self.vertices = vertices.iter().copied().take(LISTED).collect();
        self
    }

    fn at_edges(mut self, edges: &[[u32; 2]]) -> Self {
        self.edges = edges.iter().copied().take(LISTED).collect();
        self
    }

    fn at_faces(mut self, faces: &[u32]) -> Self {
        self.faces = faces.iter().copied().take(LISTED).collect();
        self
    }
}

/// The vertices of the edges with these indices.
fn edges_of(anatomy: &Anatomy, indices: &[u32]) -> Vec<[u32; 2]> {
    let edges = anatomy.topology.edges();
    indices.iter().map(|&e| edges[e as usize]).collect()
}

fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

fn indices(marks: impl Iterator<Item = bool>) -> Vec<u32> {
    (0..).zip(marks).filter(|&(_, mark)| mark).map(|(i, _)| i).collect()
}
