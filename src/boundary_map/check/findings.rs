//! Findings: the defects of a map, and what to do about them.

use super::coverage::Coverage;
use super::covering::{ComparedWith, Covering, Degree, FoldedEdges, bounds_a_solid};
use super::{MapFinding, MapFindingKind};
use crate::check::Severity;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::Topology;

/// Ids listed by a finding, at most.
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
        (!bounds_a_solid(self.domain)).then(|| MapFinding {
            kind: MapFindingKind::DomainBoundsNothing,
            severity: Severity::Warning,
            count: 1,
            edges: vec![],
            faces: vec![],
            message: "the domain is open or cannot be oriented, so that the image has no degree".into(),
            advice: "see `solidmap check DOMAIN`; a boundary map needs a closed surface".into(),
        })
    }

    fn target_bounds_nothing(&self) -> Option<MapFinding> {
        let target = self.target?;
        (!bounds_a_solid(target)).then(|| MapFinding {
            kind: MapFindingKind::TargetBoundsNothing,
            severity: Severity::Warning,
            count: 1,
            edges: vec![],
            faces: vec![],
            message: "the target is open or cannot be oriented, so that degree and flips are not to be relied on"
                .into(),
            advice: "see `solidmap check TARGET`".into(),
        })
    }

    fn topology(&self) -> Option<MapFinding> {
        let target = self.target?;
        let (ours, theirs) = (shape(self.domain), shape(target));
        (ours != theirs).then(|| MapFinding {
            kind: MapFindingKind::Topology,
            severity: Severity::Error,
            count: 1,
            edges: vec![],
            faces: vec![],
            message: format!(
                "no map between them is one to one: the domain is {}, the target {}",
                described(&ours),
                described(&theirs)
            ),
            advice: "map to a target with as many parts and handles; `solidmap check` counts them".into(),
        })
    }

    fn degree(&self) -> Option<MapFinding> {
        let Degree { value, .. } = self.covering.degree?;
        let what = match self.covering.compared_with {
            ComparedWith::Sphere { .. } => "the sphere",
            ComparedWith::Target => "the target",
            ComparedWith::Itself => "its inside",
        };
        let advice = match value {
            0 => "the image encloses nothing, or as much inside out as not: look at it, it may be flat or folded over",
            _ => "the image wraps round several times; a bijection has degree 1",
        };
        (value.abs() != 1).then(|| MapFinding {
            kind: MapFindingKind::Degree,
            severity: Severity::Error,
            count: 1,
            edges: vec![],
            faces: vec![],
            message: format!("the image covers {what} {value} times"),
            advice: advice.into(),
        })
    }

    fn uneven_covering(&self) -> Option<MapFinding> {
        let degree = self.covering.degree?;
        let share = 100.0 * (1.0 - degree.agreement);
        (degree.agreement < 1.0).then(|| MapFinding {
            kind: MapFindingKind::UnevenCovering,
            severity: Severity::Error,
            count: ((1.0 - degree.agreement) * degree.points as f64).round() as usize,
            edges: vec![],
            faces: vec![],
            message: match self.covering.compared_with {
                ComparedWith::Target => {
                    format!("of the points inside the target, {share:.2} % are covered another number of times")
                }
                _ => format!("the image overlaps itself in {share:.2} % of what it encloses"),
            },
            advice: "parts of the image are folded over, inside out, or pass through each other".into(),
        })
    }

    fn mirrored(&self) -> Option<MapFinding> {
        self.covering.is_mirrored().then(|| MapFinding {
            kind: MapFindingKind::Mirrored,
            severity: Severity::Warning,
            count: 1,
            edges: vec![],
            faces: vec![],
            message: "the map mirrors: the image of the outward side faces inward".into(),
            advice: "if that is not wanted, negate one coordinate of the image, or align with a proper rotation".into(),
        })
    }

    fn flipped(&self) -> Option<MapFinding> {
        let covering = self.covering;
        let reversed = covering.flipped.iter().copied();
        let decided = !matches!(covering.compared_with, ComparedWith::Itself);
        let wrong: Vec<u32> = if covering.is_mirrored() && decided {
            others(self.domain.triangles().len(), [&covering.flipped, &covering.degenerate])
        } else {
            reversed.collect()
        };
        (!wrong.is_empty()).then(|| MapFinding {
            kind: MapFindingKind::Flipped,
            severity: Severity::Error,
            count: wrong.len(),
            edges: vec![],
            faces: listed(&wrong),
            message: format!("{} inverted in the image", are(wrong.len(), "triangle")),
            advice: "move their vertices back into the rings of their neighbours, or make the map by `solidmap \
                     boundary`, whose maps cannot fold"
                .into(),
        })
    }

    fn degenerate(&self) -> Option<MapFinding> {
        let flat = &self.covering.degenerate;
        (!flat.is_empty()).then(|| MapFinding {
            kind: MapFindingKind::Degenerate,
            severity: Severity::Error,
            count: flat.len(),
            edges: vec![],
            faces: listed(flat),
            message: format!(
                "{} flat in the image: their corners lie on a line",
                are(flat.len(), "triangle")
            ),
            advice: "spread the images of their corners; what collapses cannot be mapped back".into(),
        })
    }

    fn folded_edges(&self) -> Option<MapFinding> {
        let edges = &self.folded.edges;
        let by_itself = matches!(self.covering.compared_with, ComparedWith::Itself);
        // Compared with a surface, flipped triangles are the better evidence, and a sharp rim is no defect.
        (by_itself && !edges.is_empty()).then(|| MapFinding {
            kind: MapFindingKind::FoldedEdges,
            severity: Severity::Warning,
            count: edges.len(),
            edges: edges.iter().take(LISTED).copied().collect(),
            faces: vec![],
            message: format!(
                "the image turns back by more than 150 degrees across {} at which the domain does not",
                counted(edges.len(), "edge")
            ),
            advice: "a fold, unless the target has a rim as sharp: name it by `--target` to find out".into(),
        })
    }

    fn not_covered(&self) -> Option<MapFinding> {
        let distance = self.coverage?.target_to_image;
        (distance.max > self.tolerance).then(|| MapFinding {
            kind: MapFindingKind::NotCovered,
            severity: Severity::Error,
            count: 1,
            edges: vec![],
            faces: vec![],
            message: format!(
                "the target is not covered: a point of it is {:.4} of its diagonal away from the image",
                distance.max
            ),
            advice: self.distance_advice(),
        })
    }

    fn off_target(&self) -> Option<MapFinding> {
        let distance = self.coverage?.image_to_target;
        (distance.max > self.tolerance).then(|| MapFinding {
            kind: MapFindingKind::OffTarget,
            severity: Severity::Warning,
            count: 1,
            edges: vec![],
            faces: vec![],
            message: format!(
                "the image leaves the target: a point of it is {:.4} of the target's diagonal away",
                distance.max
            ),
            advice: self.distance_advice(),
        })
    }

    fn distance_advice(&self) -> String {
        if self.elsewhere {
            return "the image is at another place than the target, or of another size, and was examined by itself: \
                    name the target that was mapped to, as the image has it"
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
        let mut faces: Vec<u32> = pairs.iter().flatten().copied().collect();
        faces.sort_unstable();
        faces.dedup();
        (!pairs.is_empty()).then(|| MapFinding {
            kind: MapFindingKind::SelfIntersections,
            severity: Severity::Warning,
            count: pairs.len(),
            edges: vec![],
            faces: listed(&faces),
            message: format!(
                "{} of image triangles pass through each other",
                counted(pairs.len(), "pair")
            ),
            advice: "a fold, or straight triangles between thin parts of the target: refine the domain there".into(),
        })
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

/// The triangles in neither of two ascending lists.
fn others(count: usize, lists: [&[u32]; 2]) -> Vec<u32> {
    let is_listed = |t: &u32| lists.iter().any(|list| list.binary_search(t).is_ok());
    (0..count as u32).filter(|t| !is_listed(t)).collect()
}

fn listed(ids: &[u32]) -> Vec<u32> {
    ids.iter().take(LISTED).copied().collect()
}

pub(super) fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

fn are(count: usize, noun: &str) -> String {
    format!("{} {}", counted(count, noun), if count == 1 { "is" } else { "are" })
}
