use std::fmt::{self, Display, Formatter};

use super::{
    BijectivityVerdict, BoundaryCheck, ComparedWith, CompositionCheck, Coverage, Degree, MapFinding, RoundTrip,
    SurfaceDistance,
};
use crate::check::SelfIntersections;
use crate::check::text::{counted, label_of, write_ids, write_wrapped};
use crate::worst_places::PlaceTable;

impl Display for BoundaryCheck {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        writeln!(f, "{}\n", self.headline())?;
        self.write_facts(f)?;
        if let Some(coverage) = &self.coverage {
            coverage.write_table(f)?;
        }
        if let Some(composition) = &self.composition {
            composition.write_round_trip(f)?;
        }
        if let Some(distortion) = &self.distortion {
            writeln!(f)?;
            if let Some(CompositionCheck { cuts: 1.., .. }) = &self.composition {
                writeln!(
                    f,
                    "  Measured over a subdivision of the domain, by the true images of its vertices:"
                )?;
            }
            for line in distortion.to_string().lines() {
                writeln!(f, "  {line}")?;
            }
        }
        for finding in &self.findings {
            write!(f, "\n{finding}")?;
        }
        if let Some(composition) = &self.composition {
            composition.write_remarks(f)?;
        }
        if !self.worst_places.is_empty() {
            write!(f, "\n{}", PlaceTable(&self.worst_places))?;
        }
        let names_ids = |finding: &MapFinding| !finding.faces.is_empty() || !finding.edges.is_empty();
        if self.findings.iter().any(names_ids) {
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
        let composition = self.composition.as_ref();
        let decided = match composition.is_some_and(|composition| composition.through_hyperbolic_surface) {
            true => "by exact words and by areas",
            false => "decided exactly",
        };
        match self.verdict {
            BijectivityVerdict::Bijective if self.findings.is_empty() => {
                format!("One to one with the {what}, {decided}.")
            }
            BijectivityVerdict::Bijective => format!("One to one with the {what}, {decided}; but see below."),
            BijectivityVerdict::NoDefectFound => "No defect found: one to one, as far as can be decided.".into(),
            BijectivityVerdict::Doubtful => "Perhaps one to one: see the warnings below.".into(),
            BijectivityVerdict::NotBijective => "NOT one to one.".into(),
        }
    }

    fn write_facts(&self, f: &mut Formatter) -> fmt::Result {
        let (is_composition, plain) = match self.composition {
            Some(_) => (true, ", plain image"),
            None => (false, ""),
        };
        let composition = self.composition.as_ref();
        let is_torus = composition.is_some_and(|composition| composition.through_torus);
        let is_hyperbolic = composition.is_some_and(|composition| composition.through_hyperbolic_surface);
        let is_by_shells = composition.is_some_and(|composition| composition.embeddings.len() > 2);
        let against = match self.compared_with {
            ComparedWith::Target if is_by_shells => "the target, shell by shell".into(),
            ComparedWith::Target if is_torus => "the target, through a flat torus".into(),
            ComparedWith::Target if is_hyperbolic => "the target, through a hyperbolic surface".into(),
            ComparedWith::Target if is_composition => "the target, through the sphere".into(),
            ComparedWith::Target => "the target".into(),
            _ if is_composition => "the unit sphere".into(),
            ComparedWith::Sphere { centre, radius } => {
                let [x, y, z] = centre;
                format!("the sphere that it lies on: centre ({x:.4}, {y:.4}, {z:.4}), radius {radius:.4}")
            }
            ComparedWith::Itself => "nothing but itself; a target tells more (--target)".into(),
        };
        let degree = match self.degree {
            None => "none".into(),
            Some(Degree { value, agreement, .. }) if agreement < 1.0 => {
                format!("{value} ({:.1} % of the points inside)", 100.0 * agreement)
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
}

impl Coverage {
    fn write_table(&self, f: &mut Formatter) -> fmt::Result {
        writeln!(f)?;
        write_row(f, "distance / diagonal", &["rms", "99 %", "max", "+ at most"])?;
        let row = |d: &SurfaceDistance| [d.rms, d.p99, d.max, d.max_error].map(small);
        write_row(f, "from image to target", &row(&self.image_to_target))?;
        write_row(f, "from target to image", &row(&self.target_to_image))
    }
}

impl CompositionCheck {
    fn write_round_trip(&self, f: &mut Formatter) -> fmt::Result {
        let RoundTrip { rms, p99, max, .. } = self.round_trip;
        let name = match self.embeddings[..] {
            [_] => "domain, sphere, domain",
            _ => "domain, target, domain",
        };
        writeln!(f)?;
        write_row(f, "round trip / diagonal", &["rms", "99 %", "max"])?;
        write_row(f, name, &[rms, p99, max].map(small))
    }

    fn write_remarks(&self, f: &mut Formatter) -> fmt::Result {
        let flat = (self.flat_in_target > 0).then(|| {
            format!(
                "the target has {} without area, where several points of the domain go to the same point.",
                counted(self.flat_in_target, "triangle")
            )
        });
        let flipped = (self.plain_image_flipped > 0).then(|| {
            format!(
                "the plain image mesh, straight between the images of vertices, has {} facing against the target. \
                 The map itself has none: use the boundary file.",
                counted(self.plain_image_flipped, "triangle")
            )
        });
        for remark in flat.into_iter().chain(flipped) {
            writeln!(f)?;
            write_wrapped(f, "remark: ", &remark)?;
        }
        Ok(())
    }
}

impl Display for MapFinding {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let label = label_of(self.severity);
        write_wrapped(f, &format!("{label}: "), &self.message)?;
        let edges: Vec<String> = self.edges.iter().map(|[a, b]| format!("{a}-{b}")).collect();
        write_ids(f, "edges", &edges, self.count.max(edges.len()))?;
        write_ids(f, "triangles", &self.faces, self.count.max(self.faces.len()))?;
        write_wrapped(f, "  repair: ", &self.advice)
    }
}

/// A row of a table: its name, and right-aligned columns.
fn write_row(f: &mut Formatter, name: &str, columns: &[impl Display]) -> fmt::Result {
    write!(f, "  {name:<24}")?;
    for column in columns {
        write!(f, "  {column:>9}")?;
    }
    writeln!(f)
}

/// A distance; 0 below the rounding errors of coordinates.
fn small(x: f64) -> String {
    if x < 1e-15 { "0".into() } else { format!("{x:.1e}") }
}
