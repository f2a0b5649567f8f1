//! Findings: the defects of a map, and what to do about them.

use super::coverage::Coverage;
use super::covering::{ComparedWith, Covering, Degree, FoldedEdges, bounds_a_solid};
use super::{MapFinding, MapFindingKind};
use crate::check::Severity;
use crate::check::text::counted;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;

/// Largest number of ids that a finding lists.
const LISTED: usize = 20;

/// The measurements that findings follow from.
pub(super) struct Measurements<'a> {
    pub domain: &'a SurfaceMesh,
    pub target: Option<&'a SurfaceMesh>,
    pub covering: &'a Covering,
    pub folded: &'a FoldedEdges,
    pub coverage: Option<Coverage>,
    /// Whether the image is too far from the target to be compared with it.
    pub elsewhere: bool,
    pub crossing: &'a [[u32; 2]],
    pub tolerance: f64,
}

impl Measurements<'_> {
    /// Errors first.
    pub fn findings(&self) -> Vec<MapFinding> {
        let found = [
            self.domain_bounds_nothing(),
            self.target_bounds_nothing(),
            self.topology(),
            self.degree(),
            self.uneven_covering(),
            self.mirrored(),
            self.flipped(),
            self.degenerate(),
            self.folded_edges(),
            self.not_covered(),
            self.off_target(),
            self.self_intersections(),
        ];
        let mut findings: Vec<MapFinding> = found.into_iter().flatten().collect();
        findings.sort_by_key(|finding| finding.severity);
        findings
    }

    fn domain_bounds_nothing(&self) -> Option<MapFinding> {
        let message = "the domain is open or cannot be oriented, so that the image has no degree";
        let advice = "see `solidmap check DOMAIN`; a boundary map needs a closed surface";
        (!bounds_a_solid(self.domain)).then(|| warning(MapFindingKind::DomainBoundsNothing, message, advice))
    }

    fn target_bounds_nothing(&self) -> Option<MapFinding> {
        let message = "the target is open or cannot be oriented, so that degree and flipped triangles are unreliable";
        let advice = "see `solidmap check TARGET`";
        (!bounds_a_solid(self.target?)).then(|| warning(MapFindingKind::TargetBoundsNothing, message, advice))
    }

    fn topology(&self) -> Option<MapFinding> {
        let (ours, theirs) = (shape(self.domain), shape(self.target?));
        let message = format!(
            "no map between these surfaces is one to one: the domain is {}, the target {}",
            described(&ours),
            described(&theirs)
        );
        let advice = "map to a target with the same numbers of parts and handles; `solidmap check` counts them";
        (ours != theirs).then(|| error(MapFindingKind::Topology, message, advice))
    }

    fn degree(&self) -> Option<MapFinding> {
        let Degree { value, .. } = self.covering.degree?;
        let what = match self.covering.compared_with {
            ComparedWith::Sphere { .. } => "the sphere",
            ComparedWith::Target => "the target",
            ComparedWith::Itself => "its inside",
        };
        let message = format!("the image covers {what} {value} times");
        let advice = match value {
            0 => "the image encloses no volume, or as much inside out as outward; look whether it is flat or folded",
            _ => "the image wraps round several times; a bijection has degree 1",
        };
        (value.abs() != 1).then(|| error(MapFindingKind::Degree, message, advice))
    }

    fn uneven_covering(&self) -> Option<MapFinding> {
        let degree = self.covering.degree?;
        let share = 100.0 * (1.0 - degree.agreement);
        let message = match self.covering.compared_with {
            ComparedWith::Target => {
                format!("of the points inside the target, {share:.2} % are covered a different number of times")
            }
            _ => format!("the image overlaps itself in {share:.2} % of what it encloses"),
        };
        let advice = "parts of the image are folded over, inside out, or pass through each other";
        (degree.agreement < 1.0).then(|| MapFinding {
            count: ((1.0 - degree.agreement) * degree.points as f64).round() as usize,
            ..error(MapFindingKind::UnevenCovering, message, advice)
        })
    }

    fn mirrored(&self) -> Option<MapFinding> {
        let message = "the map reverses the orientation: the image of the outward side faces inward";
        let advice = "if that is not wanted, negate one coordinate of the image, or align with a proper rotation";
        let is_mirrored = self.covering.is_mirrored();
        is_mirrored.then(|| warning(MapFindingKind::Mirrored, message, advice))
    }

    fn flipped(&self) -> Option<MapFinding> {
        let wrong = self.covering.facing_wrong_way();
        let message = format!("{} inverted in the image", are(wrong.len(), "triangle"));
        let advice = "move their vertices back into the rings of their neighbours, or make the map by `solidmap \
                      boundary`, whose maps cannot fold";
        (!wrong.is_empty()).then(|| at_faces(&wrong, error(MapFindingKind::Flipped, message, advice)))
    }

    fn degenerate(&self) -> Option<MapFinding> {
        let flat = &self.covering.degenerate;
        let are_flat = are(flat.len(), "triangle");
        let message = format!("{are_flat} flat in the image: their corners lie on a line");
        let advice = "spread the images of their corners; a collapsed triangle cannot be mapped back";
        (!flat.is_empty()).then(|| at_faces(flat, error(MapFindingKind::Degenerate, message, advice)))
    }

    fn folded_edges(&self) -> Option<MapFinding> {
        let edges = &self.folded.edges;
        let message = format!(
            "the image turns back by more than 150 degrees across {} at which the domain does not",
            counted(edges.len(), "edge")
        );
        let advice = "a fold, unless the target has an equally sharp edge there: give it as `--target` to find out";
        // Compared with a surface, flipped triangles are the better evidence, and a sharp edge is not a defect.
        let by_itself = matches!(self.covering.compared_with, ComparedWith::Itself);
        (by_itself && !edges.is_empty()).then(|| MapFinding {
            count: edges.len(),
            edges: edges.iter().take(LISTED).copied().collect(),
            ..warning(MapFindingKind::FoldedEdges, message, advice)
        })
    }

    fn not_covered(&self) -> Option<MapFinding> {
        let max = self.coverage?.target_to_image.max;
        let message =
            format!("the target is not covered: a point of it is {max:.4} of its diagonal away from the image");
        (max > self.tolerance).then(|| error(MapFindingKind::NotCovered, message, self.distance_advice()))
    }

    fn off_target(&self) -> Option<MapFinding> {
        let max = self.coverage?.image_to_target.max;
        let message = format!("the image leaves the target: a point of it is {max:.4} of the target's diagonal away");
        (max > self.tolerance).then(|| warning(MapFindingKind::OffTarget, message, self.distance_advice()))
    }

    fn distance_advice(&self) -> String {
        if self.elsewhere {
            return "the image is at another place than the target, or of another size, and was checked on its own: \
                    give the target that was mapped to, at the place and size of the image"
                .into();
        }
        format!(
            "beyond the tolerance of {}. Check that the target is the one that was mapped to, at the same place and \
             size; triangles that are large for its features cut its corners: refine the domain there",
            self.tolerance
        )
    }

    fn self_intersections(&self) -> Option<MapFinding> {
        let pairs = self.crossing;
        let mut faces = pairs.concat();
        faces.sort_unstable();
        faces.dedup();
        let counted_pairs = counted(pairs.len(), "pair");
        let message = format!("{counted_pairs} of image triangles pass through each other");
        let advice = "a fold, or straight triangles between thin parts of the target: refine the domain there";
        (!pairs.is_empty()).then(|| MapFinding {
            count: pairs.len(),
            ..at_faces(&faces, warning(MapFindingKind::SelfIntersections, message, advice))
        })
    }
}

fn error(kind: MapFindingKind, message: impl Into<String>, advice: impl Into<String>) -> MapFinding {
    MapFinding {
        kind,
        severity: Severity::Error,
        count: 1,
        edges: vec![],
        faces: vec![],
        message: message.into(),
        advice: advice.into(),
    }
}

fn warning(kind: MapFindingKind, message: impl Into<String>, advice: impl Into<String>) -> MapFinding {
    MapFinding {
        severity: Severity::Warning,
        ..error(kind, message, advice)
    }
}

/// The finding with these triangles counted and listed.
fn at_faces(faces: &[u32], finding: MapFinding) -> MapFinding {
    MapFinding {
        count: faces.len(),
        faces: faces.iter().take(LISTED).copied().collect(),
        ..finding
    }
}

/// Euler characteristic of each part, ascending.
fn shape(mesh: &SurfaceMesh) -> Vec<i64> {
    let shapes = Topology::new(mesh).components().shapes;
    let mut characteristics: Vec<i64> = shapes.iter().map(|s| s.euler_characteristic()).collect();
    characteristics.sort_unstable();
    characteristics
}

fn described(shape: &[i64]) -> String {
    match shape {
        [characteristic] if *characteristic <= 2 && characteristic % 2 == 0 => {
            format!("of genus {}", (2 - characteristic) / 2)
        }
        [characteristic] => format!("of Euler characteristic {characteristic}"),
        several => format!("of {} parts with Euler characteristics {several:?}", several.len()),
    }
}

fn are(count: usize, noun: &str) -> String {
    format!("{} {}", counted(count, noun), if count == 1 { "is" } else { "are" })
}
