use std::collections::HashMap;
use std::time::Duration;

use rayon::prelude::*;

use super::calls::{Mesh, Operation, call, call_on};
use super::error::CgalTetgenError;
use super::input::{check_manifold, check_solid, flat, points, sorted};
use crate::Point;
use crate::mesh::topology::{DisjointSets, Topology};
use crate::mesh::{SurfaceMesh, TetMesh};

/// Largest number of tetrahedra; they take about 100 GB.
const MAX_TETS: f64 = 2e8;

/// Options of [`tetrahedralize`]. The boundary is kept as it is, which limits the quality next to it.
#[derive(Debug, Clone, PartialEq)]
pub struct TetOptions {
    /// Largest ratio of a tetrahedron's circumradius to its shortest edge, at least 1.1; 1.4 to 2 is usual. `None`
    /// adds only the vertices that recovering the boundary takes.
    pub radius_edge_ratio: Option<f64>,
    /// Smallest dihedral angle aimed for, in degrees, 0 to 20. Needs `radius_edge_ratio`.
    pub min_dihedral: f64,
    /// Volume of a tetrahedron to aim for, in cubic model units. Those next to the boundary, which must not be split,
    /// stay as large as its triangles make them.
    pub max_volume: Option<f64>,
    /// Bytes that this process and a worker may take together, checked beforehand by [`memory_estimate`]. No limit when
    /// `None`.
    pub memory: Option<u64>,
}

impl Default for TetOptions {
    fn default() -> Self {
        Self {
            radius_edge_ratio: Some(1.414),
            min_dihedral: 0.0,
            max_volume: None,
            memory: None,
        }
    }
}

/// Options of [`tetrahedralize_mesh3`]. Lengths are in model units.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh3Options {
    /// Largest circumradius of a tetrahedron, and of the balls that facets and sharp edges are measured by; a
    /// twentieth of the bounding box's diagonal when `None`.
    pub cell_size: Option<f64>,
    /// Largest distance between the mesh's boundary and the surface, at the facets' centres; a twentieth of
    /// `cell_size` when `None`.
    pub facet_distance: Option<f64>,
    /// Edges whose triangles' normals differ by more than this many degrees are kept, 0 to 180.
    pub feature_angle: f64,
    /// Time limit of the run: sharp edges that nearly touch can take arbitrarily long to protect. At most 10^6 s.
    pub time_limit: Duration,
    /// As in [`TetOptions`].
    pub memory: Option<u64>,
}

impl Default for Mesh3Options {
    fn default() -> Self {
        Self {
            cell_size: None,
            facet_distance: None,
            feature_angle: 60.0,
            time_limit: Duration::from_secs(300),
            memory: None,
        }
    }
}

/// Tetrahedra that fill the solid and keep its boundary, by TetGen.
///
/// The vertices begin with those of `surface`, bit by bit; vertices that TetGen adds follow, all of them inside. The
/// boundary of the result is made of the triangles of `surface`. Tetrahedra are positively oriented. Cavities stay
/// empty and all components are filled. Runs in one process wait for one another, since TetGen is not reentrant.
///
/// # Errors
///
/// [`CgalTetgenError::InvalidInput`] for a surface that is open, degenerate, flat, with coincident or unused vertices,
/// [`CgalTetgenError::SelfIntersection`] for one that intersects itself, and an error for each check of the result:
/// vertices, boundary, orientation and volume.
pub fn tetrahedralize(surface: &SurfaceMesh, options: &TetOptions) -> Result<TetMesh, CgalTetgenError> {
    // Checked before the search for self-intersections, and again with the number of tetrahedra when the volume is
    // known.
    check_memory(surface, 0.0, options.memory)?;
    let topology = Topology::new(surface);
    let solid = check_solid(surface, &topology)?;
    // Refinement halves what is too large, so tetrahedra end at about half of the bound.
    let tets = options.max_volume.map_or(0.0, |volume| 2.0 * solid.volume / volume);
    check_tet_options(options, tets)?;
    check_memory(surface, tets, options.memory)?;

    let options = [
        options.radius_edge_ratio.unwrap_or(0.0),
        options.min_dihedral,
        options.max_volume.unwrap_or(0.0),
    ];
    let out = call_on(Operation::Tetgen, surface, &options)?;
    let tets = tets_of(&out)?;
    let vertices = points(&out.xyz);
    check_prefix(surface.vertices(), &vertices)?;

    let inside = inside_tets(surface, tets)?;
    let mesh = compacted(vertices, inside, surface.vertices().len())?;
    let mesh = positively_oriented(mesh)?;
    // Boundary and interior are exact, so only rounding is left, for which 1e-9 of the volume is generous.
    check_volume(&mesh, solid.volume, 1e-9 * solid.volume)?;
    Ok(mesh)
}

/// Circumradius of a regular tetrahedron of this volume: the [`Mesh3Options::cell_size`] for a largest volume.
pub fn regular_tet_circumradius(volume: f64) -> f64 {
    (volume * 27.0 / (8.0 * 3f64.sqrt())).cbrt()
}

/// Tetrahedra that fill the solid, by CGAL's Delaunay refinement: an alternative to [`tetrahedralize`].
///
/// The boundary is remeshed to within `facet_distance` and sharp edges are kept; vertices of `surface` are not.
/// Tetrahedra are positively oriented. Cavities stay empty and all components are filled, provided that they are larger
/// than `cell_size`. Its random numbers have a fixed seed.
///
/// # Errors
///
/// As [`tetrahedralize`]; [`CgalTetgenError::VolumeMismatch`] when the volume is further from the surface's than
/// `facet_distance` explains, as it is where parts or gaps are thinner than the mesh is fine.
pub fn tetrahedralize_mesh3(surface: &SurfaceMesh, options: &Mesh3Options) -> Result<TetMesh, CgalTetgenError> {
    check_memory(surface, 0.0, options.memory)?;
    let topology = Topology::new(surface);
    let solid = check_solid(surface, &topology)?;
    check_manifold(&topology)?;
    let cell_size = options.cell_size.unwrap_or(surface.diagonal() / 20.0);
    let facet_distance = options.facet_distance.unwrap_or(cell_size / 20.0);
    // A regular tetrahedron of circumradius r has the volume 8 r³ / (9 √3).
    let tets = 2.0 * solid.volume / cell_size.powi(3);
    check_mesh3_options(cell_size, facet_distance, options, tets)?;
    check_memory(surface, tets, options.memory)?;

    // CGAL works with squares and absolute bounds: at 1e-20 it crashes. A power of two scales without rounding.
    let unit = surface.diagonal().log2().round().exp2();
    let size = cell_size / unit;
    // Refinement is proved to end up to 30 degrees and from a ratio of 2.
    let (facet_angle, cell_radius_edge_ratio) = (25.0, 2.0);
    let sizes = [
        size,
        size,
        facet_angle,
        facet_distance / unit,
        size,
        cell_radius_edge_ratio,
        options.feature_angle,
        options.time_limit.as_secs_f64(),
    ];
    let triangles = surface.triangles().as_flattened();
    let mut xyz = flat(surface.vertices());
    xyz.iter_mut().for_each(|coordinate| *coordinate /= unit);
    let mut out = call(Operation::Mesh3, &xyz, triangles, &sizes)?;
    out.xyz.iter_mut().for_each(|coordinate| *coordinate *= unit);
    let tets = tets_of(&out)?;
    let mesh = positively_oriented(TetMesh::new(points(&out.xyz), tets.to_vec())?)?;
    check_volume(&mesh, solid.volume, 2.0 * facet_distance * surface.area())?;
    Ok(mesh)
}

/// Peak memory in bytes, a worker's included, of a run that makes this many tetrahedra, or 8 per vertex if that is
/// more, as without a bound on their volume. Within 30 % of what was measured with TetGen for 130 000 to 1 200 000
/// tetrahedra and 15 000 to 134 000 vertices (x86-64, Linux).
pub fn memory_estimate(vertices: usize, tets: f64) -> u64 {
    let tets = tets.max(8.0 * vertices as f64);
    (PROGRAM + PER_VERTEX * vertices as f64 + PER_TET * tets) as u64
}

/// Bytes of this process and the worker before they do anything.
const PROGRAM: f64 = 30e6;
/// Bytes per vertex of the surface, mostly while CGAL looks for self-intersections.
const PER_VERTEX: f64 = 4200.0;
/// Bytes per tetrahedron, in TetGen and in this process.
const PER_TET: f64 = 280.0;

fn check_memory(surface: &SurfaceMesh, tets: f64, allowed: Option<u64>) -> Result<(), CgalTetgenError> {
    let need = memory_estimate(surface.vertices().len(), tets);
    match allowed {
        Some(allowed) if need > allowed => Err(CgalTetgenError::TooLarge { need, allowed }),
        _ => Ok(()),
    }
}

fn check_tet_options(options: &TetOptions, tets: f64) -> Result<(), CgalTetgenError> {
    if let Some(ratio) = options.radius_edge_ratio {
        let requirement = "between 1.1 and 10^6; below, refinement may never end";
        check_option("radius_edge_ratio", ratio, (1.1..1e6).contains(&ratio), requirement)?;
    }
    let angle = options.min_dihedral;
    let valid = (0.0..=20.0).contains(&angle);
    check_option("min_dihedral", angle, valid, "between 0 and 20 degrees")?;
    if let Some(volume) = options.max_volume {
        check_positive("max_volume", volume)?;
        check_count("tetrahedra", tets, MAX_TETS)?;
    }
    Ok(())
}

fn check_mesh3_options(
    cell_size: f64,
    facet_distance: f64,
    options: &Mesh3Options,
    tets: f64,
) -> Result<(), CgalTetgenError> {
    check_positive("cell_size", cell_size)?;
    check_positive("facet_distance", facet_distance)?;
    let angle = options.feature_angle;
    let valid = (0.0..=180.0).contains(&angle);
    check_option("feature_angle", angle, valid, "between 0 and 180 degrees")?;
    let seconds = options.time_limit.as_secs_f64();
    check_option("time_limit", seconds, seconds <= 1e6, "at most 10^6 s")?;
    check_count("tetrahedra", tets, MAX_TETS)
}

pub(super) fn check_positive(name: &'static str, value: f64) -> Result<(), CgalTetgenError> {
    check_option(name, value, value.is_finite() && value > 0.0, "positive and finite")
}

fn check_option(name: &'static str, value: f64, valid: bool, requirement: &'static str) -> Result<(), CgalTetgenError> {
    valid.then_some(()).ok_or(CgalTetgenError::InvalidOption {
        name,
        value,
        requirement,
    })
}

pub(super) fn check_count(kind: &'static str, elements: f64, limit: f64) -> Result<(), CgalTetgenError> {
    let few = elements <= limit;
    few.then_some(())
        .ok_or(CgalTetgenError::TooFine { kind, elements, limit })
}

/// The tetrahedra that a mesher returned.
fn tets_of(mesh: &Mesh) -> Result<&[[u32; 4]], CgalTetgenError> {
    let (tets, _) = mesh.corners.as_chunks::<4>();
    (!tets.is_empty()).then_some(tets).ok_or(CgalTetgenError::EmptyResult)
}

fn check_prefix(input: &[Point], output: &[Point]) -> Result<(), CgalTetgenError> {
    let bits = |p: &Point| [p.x, p.y, p.z].map(f64::to_bits);
    let same = |k: usize| output.get(k).map(bits) == Some(bits(&input[k]));
    match (0..input.len()).find(|&k| !same(k)) {
        Some(vertex) => Err(CgalTetgenError::VertexChanged { vertex }),
        None => Ok(()),
    }
}

fn check_volume(mesh: &TetMesh, want: f64, tolerance: f64) -> Result<(), CgalTetgenError> {
    let got = mesh.volume();
    if (got - want).abs() <= tolerance {
        Ok(())
    } else {
        Err(CgalTetgenError::VolumeMismatch { got, want })
    }
}

/// The tetrahedra that an odd number of input triangles separates from the outside.
///
/// TetGen fills cavities. Counting the input triangles crossed on a path from the hull needs no point inside each
/// cavity and no orientation, and detects a boundary that leaks.
fn inside_tets(surface: &SurfaceMesh, tets: &[[u32; 4]]) -> Result<Vec<[u32; 4]>, CgalTetgenError> {
    let triangles = surface.triangles().iter().enumerate();
    let input: HashMap<[u32; 3], usize> = triangles.map(|(t, &corners)| (sorted(corners), t)).collect();
    let mut found = vec![false; input.len()];
    let outside = tets.len() as u32;
    // Union-find with parity: 2t stands for the side of the boundary that tetrahedron t is on, 2t + 1 for the other
    // side. A boundary face unites opposite sides of its two tetrahedra, any other face equal sides.
    let mut sides = DisjointSets::new(2 * (tets.len() + 1));
    let count = surface.vertices().len() as u32;
    for uses in sorted_faces(tets).chunk_by(|a, b| a >> 32 == b >> 32) {
        let face = [(uses[0] >> 96) as u32, (uses[0] >> 64) as u32, (uses[0] >> 32) as u32];
        let triangle = if face[2] < count { input.get(&face) } else { None };
        if let Some(&t) = triangle {
            found[t] = true;
        }
        let first = 2 * (uses[0] as u32);
        let second = 2 * uses.get(1).map_or(outside, |&u| u as u32);
        let crossed = u32::from(triangle.is_some());
        sides.unite(first, second + crossed);
        sides.unite(first + 1, second + 1 - crossed);
        if uses.len() > 2 || sides.find(first) == sides.find(first + 1) {
            let triangle = triangle.copied().unwrap_or(found.len());
            return Err(CgalTetgenError::BoundaryChanged { triangle });
        }
    }
    if let Some(triangle) = found.iter().position(|&f| !f) {
        return Err(CgalTetgenError::BoundaryChanged { triangle });
    }
    let other_side = sides.find(2 * outside + 1);
    let is_inside = |&t: &usize| sides.find(2 * t as u32) == other_side;
    Ok((0..tets.len()).filter(is_inside).map(|t| tets[t]).collect())
}

/// All faces of all tetrahedra in one integer each, ascending corners first and tetrahedron last, so that sorting puts
/// the two uses of a face side by side.
fn sorted_faces(tets: &[[u32; 4]]) -> Vec<u128> {
    let of_tet = |(t, &[a, b, c, d]): (usize, &[u32; 4])| {
        [[b, c, d], [a, c, d], [a, b, d], [a, b, c]].map(|face| {
            let [p, q, r] = sorted(face).map(u128::from);
            p << 96 | q << 64 | r << 32 | t as u128
        })
    };
    let mut faces: Vec<u128> = tets.iter().enumerate().flat_map(of_tet).collect();
    faces.par_sort_unstable();
    faces
}

/// The mesh without unused vertices after the first `kept`.
fn compacted(vertices: Vec<Point>, tets: Vec<[u32; 4]>, kept: usize) -> Result<TetMesh, CgalTetgenError> {
    let mut used = vec![false; vertices.len()];
    used[..kept].fill(true);
    tets.iter().flatten().for_each(|&v| used[v as usize] = true);
    let mut number = vec![0u32; vertices.len()];
    let mut next = 0;
    for (number, &used) in number.iter_mut().zip(&used) {
        *number = next;
        next += u32::from(used);
    }
    let kept = vertices.into_iter().zip(used).filter(|&(_, used)| used);
    let vertices = kept.map(|(p, _)| p).collect();
    let tets = tets.into_iter().map(|t| t.map(|v| number[v as usize])).collect();
    Ok(TetMesh::new(vertices, tets)?)
}

/// The mesh with positively oriented tetrahedra. The meshers orient all of them alike, so the sign of the total volume
/// decides; a tetrahedron of the other sign has lost its volume in rounding.
fn positively_oriented(mesh: TetMesh) -> Result<TetMesh, CgalTetgenError> {
    let mesh = if mesh.volume() < 0.0 {
        let flipped = mesh.tets().iter().map(|&[a, b, c, d]| [b, a, c, d]).collect();
        TetMesh::new(mesh.vertices().to_vec(), flipped)?
    } else {
        mesh
    };
    let positive = |t: usize| mesh.signed_volume(t) > 0.0;
    match (0..mesh.tets().len()).find(|&t| !positive(t)) {
        Some(tet) => Err(CgalTetgenError::FlatTetrahedron { tet }),
        None => Ok(mesh),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;
    use crate::mesh::shapes;

    /// TetGen without checks.
    fn unchecked(surface: &SurfaceMesh, ratio: f64) -> Result<Mesh, CgalTetgenError> {
        call_on(Operation::Tetgen, surface, &[ratio, 0.0, 0.0])
    }

    /// Each of these ends the process unless libtet's error function is replaced.
    #[test]
    fn errors_of_tetgen_are_reported() {
        let ball = shapes::sphere(1.0, 2);
        let shifted = shapes::deformed(&ball, |p| p + Vector::new(0.8, 0.1, 0.2));
        let mut doubled = ball.triangles().to_vec();
        doubled.push([doubled[0][1], doubled[0][0], doubled[0][2]]);
        let doubled = SurfaceMesh::new(ball.vertices().to_vec(), doubled).unwrap();
        for surface in [shapes::joined(&ball, &shifted), doubled] {
            for ratio in [0.0, 1.414] {
                assert_eq!(
                    unchecked(&surface, ratio).err(),
                    Some(CgalTetgenError::NearIntersection)
                );
            }
        }
    }

    #[test]
    fn tetgen_fills_cavities_and_they_are_emptied_here() {
        let shell = shapes::spherical_shell(1.0, 0.5, 2);
        let filled = unchecked(&shell, 0.0).unwrap();
        let tets = filled.corners.as_chunks::<4>().0;
        let inside = inside_tets(&shell, tets).unwrap();
        assert!(inside.len() < tets.len());
    }

    #[test]
    fn a_missing_boundary_triangle_is_named() {
        let ball = shapes::sphere(1.0, 1);
        let filled = unchecked(&ball, 0.0).unwrap();
        let tets = filled.corners.as_chunks::<4>().0;
        let mut triangles = ball.triangles().to_vec();
        triangles[7] = [0, 1, 2];
        let other = SurfaceMesh::new(ball.vertices().to_vec(), triangles).unwrap();
        assert!(matches!(
            inside_tets(&other, tets),
            Err(CgalTetgenError::BoundaryChanged { .. })
        ));
    }
}
