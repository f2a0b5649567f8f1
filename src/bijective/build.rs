//! From a map to a bijective one: a mesh of the domain is carried, and repaired.

use std::time::Instant;

use super::{BijectiveError, BijectiveMap, centroid};
use crate::Point;
use crate::boundary_map::BoundaryMap;
use crate::check::FindSelfIntersections;
use crate::geometry::{ClosestPoint, SurfaceQuery};
use crate::map::VolumeMap;
use crate::mesh::{CellList, CellMesh, SurfacePoint, TetMesh};
use crate::progress::ProgressResponse;
use crate::remesh::{
    InversionCause, RemeshError, RemeshOptions, RemeshPhase, RemeshReport, RemeshSource, Remeshed, RepairStart, remesh,
};

/// What is known of the boundary of a bijective map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BoundaryProof {
    /// It does not meet itself, in the domain nor in the target.
    OneToOne,
    /// That was not looked for.
    #[default]
    NotChecked,
}

/// A bijective map and how it was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Bijective {
    /// The map.
    pub map: BijectiveMap,
    /// How it was made.
    pub report: BijectiveReport,
}

/// How a bijective map was made, and how far it is from the map that it was made from.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct BijectiveReport {
    /// Tetrahedra, with those that splitting added.
    pub tets: usize,
    /// Their nodes.
    pub nodes: usize,
    /// Nodes on the boundary.
    pub boundary_nodes: usize,
    /// Tetrahedra that were inverted as mapped.
    pub inverted_as_mapped: usize,
    /// Where the repair began.
    pub start: RepairStart,
    /// Tetrahedra that splitting added.
    pub cells_added: usize,
    /// Least scaled Jacobian in the target.
    pub min_scaled_jacobian: f64,
    /// Distance between the two maps at the nodes and centroids of the mesh where both are finite, as a fraction of the
    /// target's diagonal: root mean square over these points.
    pub difference_rms: f64,
    /// The largest of these distances.
    pub difference_max: f64,
    /// Where in the domain the two maps differ most.
    pub difference_place: [f64; 3],
    /// Largest distance of the target's surface from the image of the mesh, as a fraction of the target's diagonal: of its
    /// vertices, and of the points where the boundary map sends the centroids of the mesh's boundary triangles.
    pub gap: f64,
    /// Whether the boundaries are proved not to meet themselves.
    pub boundary: BoundaryProof,
    /// Wall-clock seconds.
    #[serde(skip)]
    pub seconds: f64,
}

/// The piecewise linear map over `mesh`, a mesh of the domain of `boundary`, that `map` becomes by moving the images of nodes
/// inside, and by splitting tetrahedra, until none is inverted. The nodes on the boundary go exactly where the boundary
/// map sends them.
///
/// `find` finds self-intersections of the boundary. Takes as long as [`remesh`] does.
///
/// # Errors
///
/// [`BijectiveError`] where tetrahedra stay inverted or the boundary meets itself: then there is no such map, or none was
/// found. [`BijectiveError::Cancelled`] when `progress` cancels the work.
pub fn make_bijective<A: ProgressResponse>(
    boundary: &BoundaryMap,
    map: &dyn VolumeMap,
    mesh: TetMesh,
    options: &RemeshOptions,
    find: Option<FindSelfIntersections>,
    progress: &dyn Fn(RemeshPhase) -> A,
) -> Result<Bijective, BijectiveError> {
    let start = Instant::now();
    let source = RemeshSource::Given(CellMesh::from(mesh));
    let options = RemeshOptions {
        slide: false,
        ..*options
    };
    let remeshed = remesh(boundary, map, source, &options, progress).map_err(|error| match error {
        RemeshError::Cancelled => BijectiveError::Cancelled,
        other => other.into(),
    })?;
    let Remeshed {
        mesh, images, report, ..
    } = remeshed;
    if !report.after.cells.is_empty() {
        return Err(not_repaired(&report, mesh.cells(), mesh.nodes()));
    }
    let CellList::Tets(tets) = mesh.cells().clone() else {
        return Err(BijectiveError::NoTets);
    };
    let boundary_nodes = report.boundary_nodes;
    let domain = TetMesh::new(mesh.nodes().to_vec(), tets).map_err(|_| BijectiveError::NoTets)?;
    let bijective = BijectiveMap::new(domain, images)?;
    let certificate = bijective.certificate(find);
    let problems = [&certificate.domain_problems, &certificate.target_problems];
    if let Some(problem) = problems.into_iter().flatten().next() {
        return Err(BijectiveError::Boundary {
            problem: problem.clone(),
        });
    }
    let diagonal = boundary.target_diagonal();
    let surface = boundary.outward_target();
    let mut of_target = surface.vertices().to_vec();
    of_target.extend(images_between_nodes(&bijective, boundary)?);
    let distances = bijective.distances_from_image(&of_target);
    let gap = distances.into_iter().fold(0.0, f64::max);
    let bijective = bijective.with_gap(gap);

    let (points, images) = compared(&bijective);
    let differences: Vec<f64> = map
        .evaluate(&points)
        .iter()
        .zip(&images)
        .map(|(harmonic, own)| (harmonic - own).norm() / diagonal)
        .collect();
    let finite = |d: &f64| if d.is_finite() { *d } else { 0.0 };
    let most = (0..points.len()).max_by(|&a, &b| finite(&differences[a]).total_cmp(&finite(&differences[b])));
    let most = most.unwrap_or(0);
    let squares: f64 = differences.iter().map(|d| finite(d).powi(2)).sum();
    let report = BijectiveReport {
        tets: report.cells,
        nodes: report.nodes,
        boundary_nodes,
        inverted_as_mapped: report.before.cells.len(),
        start: report.repair.start,
        cells_added: report.repair.split.cells_added,
        min_scaled_jacobian: report.quality.map_or(f64::NAN, |quality| quality.min_scaled_jacobian),
        difference_rms: (squares / points.len() as f64).sqrt(),
        difference_max: finite(&differences[most]),
        difference_place: points[most].into(),
        gap: gap / diagonal,
        boundary: match certificate.boundary_checked {
            true => BoundaryProof::OneToOne,
            false => BoundaryProof::NotChecked,
        },
        seconds: start.elapsed().as_secs_f64(),
    };
    Ok(Bijective { map: bijective, report })
}

/// Where the boundary map sends the centroids of the mesh's boundary triangles: points of the target's surface far from the
/// images of nodes.
fn images_between_nodes(map: &BijectiveMap, boundary: &BoundaryMap) -> Result<Vec<Point>, BijectiveError> {
    let surface = map.domain().boundary().surface;
    let centroid = |t: &[u32; 3]| {
        let sum: crate::Vector = t.iter().map(|&v| surface.vertices()[v as usize].coords).sum();
        Point::from(sum / 3.0)
    };
    let centroids: Vec<Point> = surface.triangles().iter().map(centroid).collect();
    let query = SurfaceQuery::with_winding_sign(boundary.domain())?;
    let places = query.closest_points(&centroids);
    let places: Vec<SurfacePoint> = places.iter().map(ClosestPoint::surface_point).collect();
    Ok(boundary.evaluate(&places))
}

fn not_repaired(report: &RemeshReport, cells: &CellList, nodes: &[Point]) -> BijectiveError {
    let left = &report.after.cells;
    let causes = &report.causes_after.of_cells;
    let is_proved = |cell: &&u32| {
        matches!(
            causes[**cell as usize],
            InversionCause::Boundary | InversionCause::BlockedNode
        )
    };
    let corners: Vec<Point> = left
        .first()
        .and_then(|&cell| cells.iter().nth(cell as usize))
        .map_or(vec![], |cell| cell.iter().map(|&v| nodes[v as usize]).collect());
    let sum: crate::Vector = corners.iter().map(|p| p.coords).sum();
    BijectiveError::NotRepaired {
        left: left.len(),
        tets: report.cells,
        proved: left.iter().filter(is_proved).count(),
        exhausted: report.repair.exhausted,
        place: Point::from(sum / corners.len().max(1) as f64),
    }
}

/// The nodes and centroids of the domain's mesh, and their images.
fn compared(map: &BijectiveMap) -> (Vec<Point>, Vec<Point>) {
    let of = |mesh: &TetMesh| -> Vec<Point> {
        let centroids = (0..mesh.tets().len()).map(|tet| centroid(mesh, tet));
        mesh.vertices().iter().copied().chain(centroids).collect()
    };
    (of(map.domain()), of(map.target()))
}
