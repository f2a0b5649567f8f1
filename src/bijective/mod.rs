//! One-to-one maps of solids: linear over the tetrahedra of a mesh, none of which is inverted.
//!
//! A harmonic map need not be one to one. [`make_bijective`] carries a tet mesh of the domain by it, repairs the inverted
//! tetrahedra with the boundary fixed ([`crate::remesh`]), and returns the piecewise linear map of the result. If all
//! tetrahedra are positive, and the boundary of their image does not meet itself, that map is a homeomorphism: every point
//! off the image's boundary has as many preimages as the boundary winds about it (the degree), which is one inside.
//!
//! Boundary maps that bend within triangles need a finer boundary first: [`refined_at_boundary`].

mod build;
mod refinement;

use std::cmp::Ordering;
use std::sync::OnceLock;
use std::time::Instant;

use rayon::prelude::*;

use crate::check::{FindSelfIntersections, Finding, FindingKind, SelfIntersections, Severity, check};
use crate::geometry::{TetLocator, TetPoint, morton_order, orientation};
use crate::inverse::{Inverse, InverseReport, Preimage, PreimageStatus};
use crate::map::VolumeMap;
use crate::mesh::{SurfaceMesh, TetMesh};
use crate::{Matrix3, Point, Vector};

pub use build::{Bijective, BijectiveReport, BoundaryProof, make_bijective};
pub use refinement::{BoundaryRefinement, RefinementOptions, refined_at_boundary};

/// A one-to-one map of a solid: linear over the tetrahedra of a mesh, all of which keep their orientation.
///
/// That is checked exactly whenever one is made, also from a file. Whether the boundary of the image meets itself is left
/// to [`Self::certificate`].
///
/// As a [`VolumeMap`] its Jacobian is constant in each tetrahedron. Points outside of the mesh have the image of the closest
/// point. Points that are not finite have NaN. The tetrahedron of a point is found by exact predicates, in about a
/// microsecond, with a tree that is built at the first evaluation.
#[derive(Debug, Clone)]
pub struct BijectiveMap {
    domain: TetMesh,
    /// The same tetrahedra over the images of the vertices.
    target: TetMesh,
    gap: f64,
    in_domain: OnceLock<TetLocator>,
    in_target: OnceLock<TetLocator>,
}

/// Why a map is not one to one, or could not be made so.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BijectiveError {
    /// The mesh has no tetrahedra.
    #[error("the mesh has no tetrahedra")]
    NoTets,
    /// Another number of images than of nodes.
    #[error("there are {images} images for {nodes} nodes; give one for each")]
    ImageCount {
        /// Nodes of the mesh.
        nodes: usize,
        /// Images given.
        images: usize,
    },
    /// Tetrahedra are flat, or have not all one orientation; or a corner is not finite.
    #[error(
        "{count} of {tets} tetrahedra are inverted or flat in the {solid}, one of them near ({x:.4}, {y:.4}, {z:.4})",
        x = place[0], y = place[1], z = place[2]
    )]
    Inverted {
        /// `"domain"` or `"target"`.
        solid: &'static str,
        /// How many.
        count: usize,
        /// Tetrahedra of the mesh.
        tets: usize,
        /// The first of them, 0-based.
        first: usize,
        /// Its centroid: a mesh that was divided at its boundary has other numbers than the file it is from.
        place: Point,
    },
    /// The repair left inverted tetrahedra.
    #[error(
        "{left} of {tets} tetrahedra stay inverted ({proved} of them provably so, as long as the boundary stays), one of them near \
         ({x:.4}, {y:.4}, {z:.4}) in the domain; {}a finer mesh may help, or a boundary map that distorts less there",
        if *exhausted { "the repair ended at its limit: more effort, " } else { "" },
        x = place[0], y = place[1], z = place[2]
    )]
    NotRepaired {
        /// How many stay inverted.
        left: usize,
        /// Tetrahedra of the mesh.
        tets: usize,
        /// Those that are proved to stay inverted as long as the boundary does not move.
        proved: usize,
        /// Whether the repair ended at its limit of effort.
        exhausted: bool,
        /// The centroid of one of them in the domain.
        place: Point,
    },
    /// The boundary of the mesh or of its image meets itself, or does not bound a solid.
    #[error(
        "the boundary of the mesh or of its image is wrong: {problem}. The boundary map is not one to one there, or the boundary of the \
         mesh is too coarse for it (`solidmap boundary check` tells which)"
    )]
    Boundary {
        /// What was found, and where.
        problem: String,
    },
    /// The mesh could not be carried and repaired.
    #[error(transparent)]
    Remesh(#[from] crate::remesh::RemeshError),
    /// An option is out of range.
    #[error("{option} is {value}, but must be {range}")]
    Option {
        /// The field of [`RefinementOptions`].
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// A surface cannot be queried.
    #[error(transparent)]
    Query(#[from] crate::geometry::QueryError),
    /// The progress callback cancelled the work.
    #[error("cancelled by the progress callback")]
    Cancelled,
}

/// What proves that a map is one to one.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct BijectivityCertificate {
    /// Tetrahedra, all with one orientation in the domain and in the target: decided exactly.
    pub tets: usize,
    /// Whether the map turns the solid inside out as a whole.
    pub mirrored: bool,
    /// What is wrong with the boundary of the mesh, in words; nothing if it bounds a solid.
    pub domain_problems: Vec<String>,
    /// What is wrong with the boundary of the image.
    pub target_problems: Vec<String>,
    /// Whether self-intersections of the boundaries were looked for; without, nothing is proved of them.
    pub boundary_checked: bool,
}

impl BijectivityCertificate {
    /// Whether the map is proved to be one to one.
    pub fn is_one_to_one(&self) -> bool {
        self.boundary_checked && self.domain_problems.is_empty() && self.target_problems.is_empty()
    }
}

/// Points per task.
const RUN: usize = 512;
/// Distance from the mesh, over its largest coordinate, that counts as zero: the coordinates of a point of the boundary are
/// rounded by as much.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

impl BijectiveMap {
    /// The map that sends node `v` of the mesh to `images[v]`.
    ///
    /// # Errors
    ///
    /// [`BijectiveError::Inverted`] unless all tetrahedra have one orientation in the mesh and one in the image, exactly;
    /// [`BijectiveError::NoTets`], [`BijectiveError::ImageCount`].
    pub fn new(mesh: TetMesh, images: Vec<Point>) -> Result<Self, BijectiveError> {
        let counts = (mesh.vertices().len(), images.len());
        let target = mesh.with_vertices(images).ok_or(BijectiveError::ImageCount {
            nodes: counts.0,
            images: counts.1,
        })?;
        for (solid, mesh) in [("domain", &mesh), ("target", &target)] {
            require_one_orientation(solid, mesh)?;
        }
        Ok(Self {
            domain: mesh,
            target,
            gap: 0.0,
            in_domain: OnceLock::new(),
            in_target: OnceLock::new(),
        })
    }

    /// The same map, for a target whose surface is up to `gap` away from the image of the mesh, in units of the target:
    /// points outside of the image, but no farther from it, have the preimage of the closest point of the image.
    pub fn with_gap(self, gap: f64) -> Self {
        Self { gap, ..self }
    }

    /// The mesh of the domain.
    pub fn domain(&self) -> &TetMesh {
        &self.domain
    }

    /// Its image: the same tetrahedra over the images of the nodes.
    pub fn target(&self) -> &TetMesh {
        &self.target
    }

    /// How far the target's surface is from the image of the mesh at most, in units of the target.
    pub fn gap(&self) -> f64 {
        self.gap
    }

    /// Whether the map turns the solid inside out.
    pub fn is_mirrored(&self) -> bool {
        sign(&self.domain, 0) != sign(&self.target, 0)
    }

    /// Checks the boundaries of mesh and image, which decides whether the map is one to one. `find` finds
    /// self-intersections, as CGAL does in builds with the feature `native`.
    pub fn certificate(&self, find: Option<FindSelfIntersections>) -> BijectivityCertificate {
        let mirrored = self.is_mirrored();
        let problems = |mesh: &TetMesh| -> (Vec<String>, bool) {
            let boundary = outward(mesh.boundary().surface);
            let found = check(&boundary, find);
            let checked = matches!(found.self_intersections, SelfIntersections::Checked { .. });
            let matters = |finding: &&Finding| {
                finding.severity == Severity::Error
                    || matches!(
                        finding.kind,
                        FindingKind::SelfIntersections | FindingKind::NonManifoldVertices
                    )
            };
            let problems = found
                .findings
                .iter()
                .filter(matters)
                .map(|finding| finding.message.clone());
            (problems.collect(), checked)
        };
        let (domain_problems, first) = problems(&self.domain);
        let (target_problems, second) = problems(&self.target);
        BijectivityCertificate {
            tets: self.domain.tets().len(),
            mirrored,
            domain_problems,
            target_problems,
            boundary_checked: first && second,
        }
    }

    /// Preimages of the points, by point location in the image: exact up to the rounding of their coordinates.
    ///
    /// A point outside of the image by more than the gap ([`Self::with_gap`]) and by more than rounding is
    /// [`PreimageStatus::Outside`].
    pub fn preimages(&self, points: &[Point]) -> (Vec<Preimage>, InverseReport) {
        let start = Instant::now();
        let largest = self
            .target
            .vertices()
            .iter()
            .map(|p| p.coords.amax())
            .fold(0.0, f64::max);
        let allowed = self.gap.max(ROUNDING * largest);
        let diagonal = diagonal(&self.target);
        let nan = Point::from([f64::NAN; 3]);
        let places = self.at_points(Side::Target, points, None, |at| {
            Some((self.mean(&self.domain, at), at.distance))
        });
        let positions: Vec<Point> = places
            .iter()
            .map(|place| place.map_or(nan, |(point, _)| point))
            .collect();
        let images = self.evaluate(&positions);
        let preimages: Vec<Preimage> = points
            .iter()
            .zip(&places)
            .zip(images)
            .map(|((y, place), image)| match place {
                None => Preimage {
                    status: PreimageStatus::NotFinite,
                    point: nan,
                    round_trip: f64::INFINITY,
                    preimages: 0,
                    beyond_boundary: false,
                },
                Some((point, distance)) => {
                    let is_inside = *distance <= allowed;
                    Preimage {
                        status: if is_inside {
                            PreimageStatus::Ok
                        } else {
                            PreimageStatus::Outside
                        },
                        point: *point,
                        round_trip: (image - y).norm() / diagonal,
                        preimages: usize::from(is_inside),
                        beyond_boundary: false,
                    }
                }
            })
            .collect();
        let mut report = InverseReport::of(&preimages);
        report.boundary_error = self.gap / diagonal;
        report.seconds = start.elapsed().as_secs_f64();
        (preimages, report)
    }

    /// Distances of points of the target's surface from the image of the mesh; 0 inside.
    fn distances_from_image(&self, points: &[Point]) -> Vec<f64> {
        self.at_points(Side::Target, points, f64::NAN, |at| at.distance)
    }

    /// The weighted mean of a tetrahedron's corners in either mesh.
    fn mean(&self, mesh: &TetMesh, at: &TetPoint) -> Point {
        let corners = mesh.corners(at.tet as usize);
        let weighted = corners
            .iter()
            .zip(at.barycentric)
            .map(|(corner, weight)| corner.coords * weight);
        Point::from(weighted.sum::<Vector>())
    }

    /// The value at each point, found along a space-filling curve, so that neighbours read the same part of the tree;
    /// `undefined` at points that are not finite.
    fn at_points<T: Copy + Send + Sync>(
        &self,
        side: Side,
        points: &[Point],
        undefined: T,
        value: impl Fn(&TetPoint) -> T + Sync,
    ) -> Vec<T> {
        let (mesh, locator) = match side {
            Side::Domain => (&self.domain, &self.in_domain),
            Side::Target => (&self.target, &self.in_target),
        };
        let locator = locator.get_or_init(|| TetLocator::new(mesh, |_| true));
        let order = morton_order(points);
        let found: Vec<T> = order
            .par_chunks(RUN)
            .flat_map_iter(|run| {
                let locate = |&i: &u32| locator.locate(mesh, &points[i as usize]);
                run.iter().map(locate).map(|at| at.as_ref().map_or(undefined, &value))
            })
            .collect();
        let mut values = vec![undefined; points.len()];
        for (&i, value) in order.iter().zip(found) {
            values[i as usize] = value;
        }
        values
    }

    fn jacobian_in(&self, tet: u32) -> Matrix3 {
        let edges = |mesh: &TetMesh| {
            let [a, b, c, d] = mesh.corners(tet as usize);
            Matrix3::from_columns(&[b - a, c - a, d - a])
        };
        // J E = F for the edges E and their images F, solved as Eᵀ Jᵀ = Fᵀ.
        let solved = edges(&self.domain)
            .transpose()
            .full_piv_lu()
            .solve(&edges(&self.target).transpose());
        solved.map_or(Matrix3::repeat(f64::NAN), |j| j.transpose())
    }
}

/// Which of the two meshes points are located in.
#[derive(Clone, Copy)]
enum Side {
    Domain,
    Target,
}

impl VolumeMap for BijectiveMap {
    fn evaluate(&self, points: &[Point]) -> Vec<Point> {
        self.at_points(Side::Domain, points, Point::from([f64::NAN; 3]), |at| {
            self.mean(&self.target, at)
        })
    }

    fn jacobian(&self, points: &[Point]) -> Vec<Matrix3> {
        self.at_points(Side::Domain, points, Matrix3::repeat(f64::NAN), |at| {
            self.jacobian_in(at.tet)
        })
    }
}

impl Inverse for BijectiveMap {
    fn preimages(&self, points: &[Point]) -> (Vec<Preimage>, InverseReport) {
        self.preimages(points)
    }
}

/// Equal if their meshes, images and gaps are.
impl PartialEq for BijectiveMap {
    fn eq(&self, other: &Self) -> bool {
        (&self.domain, &self.target, self.gap) == (&other.domain, &other.target, other.gap)
    }
}

fn sign(mesh: &TetMesh, tet: usize) -> Option<Ordering> {
    let [a, b, c, d] = mesh.corners(tet);
    orientation(&a, &b, &c, &d)
}

fn centroid(mesh: &TetMesh, tet: usize) -> Point {
    let sum: Vector = mesh.corners(tet).iter().map(|p| p.coords).sum();
    Point::from(sum / 4.0)
}

/// Refuses flat tetrahedra, and those of the other orientation than most.
fn require_one_orientation(solid: &'static str, mesh: &TetMesh) -> Result<(), BijectiveError> {
    let tets = mesh.tets().len();
    if tets == 0 {
        return Err(BijectiveError::NoTets);
    }
    let signs: Vec<_> = (0..tets).into_par_iter().map(|t| sign(mesh, t)).collect();
    let positive = signs.iter().filter(|s| **s == Some(Ordering::Greater)).count();
    let most = if 2 * positive >= tets {
        Ordering::Greater
    } else {
        Ordering::Less
    };
    let mut others = (0..tets).filter(|&t| signs[t] != Some(most)).peekable();
    match others.peek().copied() {
        None => Ok(()),
        Some(first) => Err(BijectiveError::Inverted {
            solid,
            count: others.count(),
            tets,
            first,
            place: centroid(mesh, first),
        }),
    }
}

fn outward(surface: SurfaceMesh) -> SurfaceMesh {
    if surface.volume() < 0.0 {
        surface.reversed()
    } else {
        surface
    }
}

fn diagonal(mesh: &TetMesh) -> f64 {
    mesh.bounding_box().map_or(0.0, |(low, high)| (high - low).norm())
}
