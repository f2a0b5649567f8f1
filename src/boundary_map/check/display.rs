use std::fmt::{self, Display, Formatter};

use super::findings::counted;
use super::{BijectivityVerdict, BoundaryCheck, ComparedWith, CompositionCheck, MapFinding, SurfaceDistance};
use crate::check::text::{write_ids, write_wrapped};
use crate::check::{SelfIntersections, Severity};

impl Display for BoundaryCheck {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        writeln!(f, "{}\n", self.headline())?;
        self.write_facts(f)?;
        if let Some(coverage) = &self.coverage {
            self.write_coverage(f, [&coverage.image_to_target, &coverage.target_to_image])?;
        }
        if let Some(composition) = &self.composition {
            composition.write_round_trip(f)?;
        }
        if let Some(distortion) = &self.distortion {
            writeln!(f)?;
            if let Some(CompositionCheck { cuts: 1.., .. }) = &self.composition {
                writeln!(
                    f,
                    "  Measured over triangles of the domain cut into smaller ones, by their true images:"
                )?;
            }
            distortion
                .to_string()
                .lines()
                .try_for_each(|line| writeln!(f, "  {line}"))?;
        }
        for finding in &self.findings {
            write!(f, "\n{finding}")?;
        }
        if let Some(composition) = &self.composition {
            composition.write_remarks(f)?;
        }
        if self
            .findings
            .iter()
            .any(|found| !found.faces.is_empty() || !found.edges.is_empty())
        {
            writeln!(f, "\nVertices and triangles are counted from 0.")?;
        }
        Ok(())
    }
}

impl BoundaryCheck {
    fn headline(&self) -> String {
        let what = match self.compared_with {
            ComparedWith::Target => "target",
            _ => "sphere",
        };
        match self.verdict {
            BijectivityVerdict::Bijective if self.findings.is_empty() => {
                format!("One to one with the {what}, decided exactly.")
            }
            BijectivityVerdict::Bijective => format!("One to one with the {what}, decided exactly; but see below."),
            BijectivityVerdict::NoDefectFound => "One to one, as far as can be told: nothing speaks against it.".into(),
            BijectivityVerdict::Doubtful => "Perhaps one to one, but there are doubts.".into(),
            BijectivityVerdict::NotBijective => "NOT one to one.".into(),
        }
    }

    fn write_facts(&self, f: &mut Formatter) -> fmt::Result {
        let against = match self.compared_with {
            _ if self.composition.is_some() => match self.compared_with {
                ComparedWith::Target => "the target, through the sphere".into(),
                _ => "the unit sphere".into(),
            },
            ComparedWith::Sphere {
                centre: [x, y, z],
                radius,
            } => {
                format!("the sphere that it lies on: centre ({x:.4}, {y:.4}, {z:.4}), radius {radius:.4}")
            }
            ComparedWith::Target => "the target".into(),
            ComparedWith::Itself => "nothing but itself; a target tells more (--target)".into(),
        };
        let degree = match self.degree {
            None => "none".into(),
            Some(degree) if degree.agreement < 1.0 => {
                format!(
                    "{} ({:.1} % of the points inside)",
                    degree.value,
                    100.0 * degree.agreement
                )
            }
            Some(degree) => degree.value.to_string(),
        };
        let intersections = match &self.self_intersections {
            SelfIntersections::NotChecked { reason } => format!("not checked: {reason}"),
            SelfIntersections::Checked { pairs } => format!("{pairs} pairs of triangles"),
        };
        let flat = match self.flat_in_domain {
            0 => String::new(),
            count => format!(" (and {count} in the domain)"),
        };
        let plain = if self.composition.is_some() {
            ", plain image"
        } else {
            ""
        };
        let (folded, crossing) = (format!("folded edges{plain}"), format!("self-intersections{plain}"));
        for (name, fact) in [
            ("triangles", self.faces.to_string()),
            ("compared with", against),
            ("degree", degree),
            ("flipped triangles", self.flipped.to_string()),
            ("degenerate triangles", format!("{}{flat}", self.degenerate)),
            (&folded, self.folded_edges.to_string()),
            (&crossing, intersections),
        ] {
            writeln!(f, "  {name:<width$} {fact}", width = 22 + plain.len())?;
        }
        Ok(())
    }

    fn write_coverage(&self, f: &mut Formatter, distances: [&SurfaceDistance; 2]) -> fmt::Result {
        let [rms, p99, max, error] = ["rms", "99 %", "max", "+ at most"];
        let head = "distance / diagonal";
        writeln!(f, "\n  {head:<24}  {rms:>9}  {p99:>9}  {max:>9}  {error:>9}")?;
        for (name, d) in ["from image to target", "from target to image"]
            .into_iter()
            .zip(distances)
        {
            let [rms, p99, max, error] = [d.rms, d.p99, d.max, d.max_error].map(small);
            writeln!(f, "  {name:<24}  {rms:>9}  {p99:>9}  {max:>9}  {error:>9}")?;
        }
        Ok(())
    }
}

impl CompositionCheck {
    fn write_round_trip(&self, f: &mut Formatter) -> fmt::Result {
        let trip = &self.round_trip;
        let [rms, p99, max] = [trip.rms, trip.p99, trip.max].map(small);
        let head = "round trip / diagonal";
        writeln!(f, "\n  {head:<24}  {:>9}  {:>9}  {:>9}", "rms", "99 %", "max")?;
        let name = match self.embeddings[..] {
            [_] => "domain, sphere, domain",
            _ => "domain, target, domain",
        };
        writeln!(f, "  {name:<24}  {rms:>9}  {p99:>9}  {max:>9}")
    }

    fn write_remarks(&self, f: &mut Formatter) -> fmt::Result {
        if self.flat_in_target > 0 {
            let remark = format!(
                "{} of the target have no area, so that several points of the domain go to the same point there.",
                counted(self.flat_in_target, "triangle")
            );
            writeln!(f)?;
            write_wrapped(f, "remark: ", &remark)?;
        }
        if self.plain_image_flipped > 0 {
            let remark = format!(
                "the plain image mesh, straight between the images of vertices, has {} that face against the target. The \
                 map itself has none: use the boundary file.",
                counted(self.plain_image_flipped, "triangle")
            );
            writeln!(f)?;
            write_wrapped(f, "remark: ", &remark)?;
        }
        Ok(())
    }
}

impl Display for MapFinding {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let label = match self.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        write_wrapped(f, &format!("{label}: "), &self.message)?;
        let edges: Vec<String> = self.edges.iter().map(|[a, b]| format!("{a}-{b}")).collect();
        let faces: Vec<String> = self.faces.iter().map(u32::to_string).collect();
        for (name, ids) in [("edges", edges), ("triangles", faces)] {
            write_ids(f, name, &ids, self.count.max(ids.len()))?;
        }
        write_wrapped(f, "  repair: ", &self.advice)
    }
}

/// Rounding errors of coordinates are no distances.
fn small(x: f64) -> String {
    if x < 1e-15 { "0".into() } else { format!("{x:.1e}") }
}
