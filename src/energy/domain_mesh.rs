//! Quadrature over a mesh that has to fill the domain of a map, and nothing else.

use super::hex_quadrature::cell_quadrature;
use super::quadrature::{Quadrature, QuadratureError};
use crate::check::{CellFindingKind, Severity, examine_cells};
use crate::geometry::{QueryError, SurfaceQuery};
use crate::mesh::{CellMesh, SurfaceMesh};

/// Largest distance of a boundary vertex from the domain's surface, as a fraction of its diagonal: a mesh that comes from
/// elsewhere may approximate the surface, but where it leaves the domain the map means nothing.
const MOST_DISTANCE: f64 = 0.01;
/// Largest difference of the volumes, as a fraction of the domain's.
const MOST_MISSING: f64 = 0.05;
/// As [`MOST_DISTANCE`], but for a warning.
const NOTABLE_DISTANCE: f64 = 1e-3;
/// As [`MOST_MISSING`], but for a warning: half of the error that adaptive quadrature leaves by default.
const NOTABLE_MISSING: f64 = 5e-3;

/// Quadrature over a mesh of the domain.
#[derive(Debug, Clone, PartialEq)]
pub struct DomainMeshQuadrature {
    /// The points and weights, as by [`cell_quadrature`].
    pub quadrature: Quadrature,
    /// Where the mesh differs from the domain by so much that energies may be off, for the user to read.
    pub warnings: Vec<String>,
}

/// Why a mesh cannot stand for the domain of a map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DomainMeshError {
    /// Cells are inverted, listed twice or otherwise not valid, so that parts of the domain count twice or not at all.
    #[error(
        "{message}; integrals would count parts of the domain twice or not at all. Leave the mesh out, so that a grid is \
         used, or repair it: `solidmap check` says how"
    )]
    Cells {
        /// What is wrong, and where.
        message: String,
    },
    /// The volume is not that of the domain.
    #[error(
        "the mesh has a volume of {volume:.6}, and the domain of the map {expected:.6}; give a mesh of the domain \
         (`solidmap tet` makes one)"
    )]
    Volume {
        /// That of the mesh.
        volume: f64,
        /// That of the domain.
        expected: f64,
    },
    /// The boundary lies elsewhere.
    #[error(
        "boundary vertex {vertex} of the mesh is {:.2} % of the domain's diagonal away from its surface; give a mesh of \
         the domain, in its coordinates (`solidmap tet` makes one)",
        100.0 * distance
    )]
    Distance {
        /// The farthest vertex of the mesh's boundary.
        vertex: u32,
        /// How far, as a fraction of the domain's diagonal.
        distance: f64,
    },
    /// The mesh cannot be integrated over.
    #[error(transparent)]
    Quadrature(#[from] QuadratureError),
    /// The domain's surface has nothing to measure distances from.
    #[error(transparent)]
    Surface(#[from] QueryError),
}

/// [`cell_quadrature`] over a mesh that fills the domain of a map, which is examined first ([`examine_cells`], its volume,
/// and how far its boundary is from the domain's).
///
/// Cells without volume and vertices that hang in the faces of larger cells do no harm to integrals and are accepted.
///
/// # Errors
///
/// [`DomainMeshError`] when cells are not valid, when the volumes differ by more than 5 %, and when the boundary of the
/// mesh is farther than 1 % of the diagonal from the domain's.
pub fn domain_mesh_quadrature(mesh: &CellMesh, domain: &SurfaceMesh) -> Result<DomainMeshQuadrature, DomainMeshError> {
    let quadrature = cell_quadrature(mesh)?;
    let harmless = [
        CellFindingKind::FlatCells,
        CellFindingKind::HangingNodes,
        CellFindingKind::MismatchedFaces,
    ];
    let mut errors = examine_cells(mesh).findings;
    errors.retain(|f| f.severity == Severity::Error && !harmless.contains(&f.kind));
    // The copy of a cell counts as inverted, too.
    errors.sort_by_key(|f| f.kind != CellFindingKind::DuplicateCells);
    if let Some(error) = errors.into_iter().next() {
        return Err(DomainMeshError::Cells { message: error.message });
    }
    let (volume, expected) = (quadrature.volume(), domain.volume());
    let excess = volume / expected - 1.0;
    if excess.is_nan() || excess.abs() > MOST_MISSING {
        return Err(DomainMeshError::Volume { volume, expected });
    }
    let boundary = mesh.boundary();
    let closest = SurfaceQuery::new(domain)?.closest_points(boundary.surface.vertices());
    let diagonal = domain.diagonal();
    let distances = closest.iter().map(|found| found.distance / diagonal);
    let (vertex, distance) =
        distances.zip(&boundary.vertex_ids).fold(
            (0, 0.0),
            |worst, (distance, &v)| {
                if distance > worst.1 { (v, distance) } else { worst }
            },
        );
    if distance > MOST_DISTANCE {
        return Err(DomainMeshError::Distance { vertex, distance });
    }
    let mut warnings = Vec::new();
    if distance > NOTABLE_DISTANCE {
        warnings.push(format!(
            "boundary vertex {vertex} of the mesh is {:.2} % of the domain's diagonal away from its surface; energies \
             are those of the map inside the mesh",
            100.0 * distance
        ));
    }
    if excess.abs() > NOTABLE_MISSING {
        warnings.push(format!(
            "the volume of the mesh is {:.2} % {} than that of the domain; energies are those of the map inside the mesh",
            100.0 * excess.abs(),
            if excess > 0.0 { "larger" } else { "smaller" }
        ));
    }
    Ok(DomainMeshQuadrature { quadrature, warnings })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TetMesh, shapes};
    use crate::{Point, Vector};

    /// The cube `[-1/2, 1/2]³` in `6 n³` tetrahedra.
    fn cube(n: u32) -> (Vec<Point>, Vec<[u32; 4]>) {
        let side = n + 1;
        let place = |k: u32| [k % side, k / side % side, k / side / side].map(|i| f64::from(i) / f64::from(n) - 0.5);
        let nodes = (0..side.pow(3)).map(|k| Point::from(place(k))).collect();
        let steps = [1, side, side * side];
        let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [2, 1, 0], [0, 2, 1]];
        let of_cell = |low: u32| {
            orders.iter().enumerate().map(move |(k, &[a, b, _])| {
                let path = [
                    low,
                    low + steps[a],
                    low + steps[a] + steps[b],
                    low + steps.iter().sum::<u32>(),
                ];
                if k < 3 {
                    path
                } else {
                    [path[1], path[0], path[2], path[3]]
                }
            })
        };
        let lows = (0..n.pow(3)).map(|c| c % n + c / n % n * steps[1] + c / n / n * steps[2]);
        (nodes, lows.flat_map(of_cell).collect())
    }

    fn measured(nodes: Vec<Point>, tets: Vec<[u32; 4]>) -> Result<DomainMeshQuadrature, DomainMeshError> {
        domain_mesh_quadrature(&TetMesh::new(nodes, tets).unwrap().into(), &shapes::cube(1.0, 4))
    }

    #[test]
    fn a_mesh_of_the_domain_is_taken_and_a_shifted_one_refused() {
        let (nodes, tets) = cube(4);
        let found = measured(nodes.clone(), tets.clone()).unwrap();
        assert!((found.quadrature.volume() - 1.0).abs() < 1e-14 && found.warnings.is_empty());
        let shifted = |by: f64| {
            let by = Vector::new(by, 0.0, 0.0);
            measured(nodes.iter().map(|p| p + by).collect(), tets.clone())
        };
        assert_eq!(shifted(0.01).unwrap().warnings.len(), 1);
        assert!(matches!(shifted(0.05), Err(DomainMeshError::Distance { distance, .. }) if distance > 0.028));
        let scaled = |by: f64| measured(nodes.iter().map(|p| p * by).collect(), tets.clone());
        assert_eq!(scaled(0.996).unwrap().warnings.len(), 2);
        assert!(matches!(scaled(0.9), Err(DomainMeshError::Volume { .. })));
    }

    #[test]
    fn cells_that_count_twice_or_leave_holes_are_refused() {
        let (nodes, tets) = cube(4);
        let middle = nodes.len() / 2;
        let mut folded = nodes.clone();
        folded[middle] += Vector::new(0.3, 0.02, 0.01);
        let refused = |found: Result<DomainMeshQuadrature, DomainMeshError>, words: &str| {
            let error = found.unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        };
        refused(measured(folded, tets.clone()), "inverted");
        let twice = [&tets[..], &tets[..1]].concat();
        refused(measured(nodes.clone(), twice), "the vertices of an earlier one");
        let mut collapsed = tets.clone();
        collapsed[5][3] = collapsed[5][2];
        refused(measured(nodes.clone(), collapsed), "names a vertex twice");
        // Without one of 384 tetrahedra the volume is almost right; the hole's walls are inside the domain.
        let inner = tets.iter().position(|tet| tet.contains(&(middle as u32))).unwrap();
        let mut open = tets.clone();
        open.remove(inner);
        refused(measured(nodes.clone(), open), "away from its surface");
        refused(measured(nodes, vec![]), "no tetrahedron");
    }

    #[test]
    fn flat_cells_do_no_harm() {
        let (mut nodes, mut tets) = cube(2);
        // The middle of an edge of the outer face x = −1/2 cuts the only tetrahedron there in two, and a flat one is put
        // between its halves' outer faces and a copy of the whole face.
        let face: Vec<u32> = (0..nodes.len() as u32)
            .filter(|&v| nodes[v as usize].x == -0.5)
            .collect();
        let on_face = |tet: &[u32; 4]| tet.iter().filter(|v| face.contains(v)).count() == 3;
        let cut = tets.iter().position(on_face).unwrap();
        let tet = tets[cut];
        let far = tet.into_iter().position(|v| !face.contains(&v)).unwrap();
        let [a, b, c] = std::array::from_fn(|k| tet[(far + 1 + k) % 4]);
        let middle = nodes.len() as u32;
        let centre = (nodes[a as usize].coords + nodes[b as usize].coords + nodes[c as usize].coords) / 3.0;
        nodes.push(Point::from(centre));
        tets.push([a, b, c, middle]);
        let found = measured(nodes, tets).unwrap();
        assert!((found.quadrature.volume() - 1.0).abs() < 1e-14, "{found:?}");
    }
}
