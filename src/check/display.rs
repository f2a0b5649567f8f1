use std::fmt::{self, Display, Formatter};

use super::text::{counted, label_of, write_ids, write_wrapped};
use super::{CheckReport, ComponentKind, ComponentReport, Finding, SelfIntersections};

/// Components listed one by one; the rest are counted.
const LISTED: usize = 40;

impl Display for CheckReport {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        writeln!(f, "{}", self.verdict())?;
        writeln!(f)?;
        self.write_facts(f)?;
        self.write_components(f)?;
        for finding in &self.findings {
            write!(f, "\n{finding}")?;
        }
        if !self.findings.is_empty() {
            writeln!(f, "\nVertices and triangles are counted from 0.")?;
        }
        Ok(())
    }
}

impl Display for Finding {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        writeln!(f, "{}: {}", label_of(self.severity), self.message)?;
        let edges: Vec<String> = self.edges.iter().map(|[a, b]| format!("{a}-{b}")).collect();
        write_ids(f, "vertices", &self.vertices, self.vertices.len())?;
        write_ids(f, "edges", &edges, edges.len())?;
        write_ids(f, "triangles", &self.faces, self.faces.len())?;
        write_wrapped(f, "  repair: ", &self.advice)
    }
}

impl CheckReport {
    fn verdict(&self) -> String {
        let (errors, warnings) = (self.errors().count(), self.warnings().count());
        match (errors, warnings) {
            (0, 0) => match &self.self_intersections {
                SelfIntersections::NotChecked { .. } => {
                    "Healthy, as far as it was checked: the surface bounds a solid.".to_string()
                }
                SelfIntersections::Checked { .. } => "Healthy: the surface bounds a solid.".to_string(),
            },
            (0, _) => format!("Solvable, with {}.", counted(warnings, "warning")),
            (_, 0) => format!("Not solvable: {}.", counted(errors, "error")),
            _ => format!(
                "Not solvable: {}, {}.",
                counted(errors, "error"),
                counted(warnings, "warning")
            ),
        }
    }

    fn write_facts(&self, f: &mut Formatter) -> fmt::Result {
        let yes = |fact: bool| if fact { "yes" } else { "NO" }.to_string();
        let intersections = match &self.self_intersections {
            SelfIntersections::NotChecked { reason } => format!("not checked: {reason}"),
            SelfIntersections::Checked { pairs: 0 } => "none".to_string(),
            SelfIntersections::Checked { pairs } => format!("{pairs} PAIRS OF TRIANGLES"),
        };
        let size = match self.bounding_box {
            Some([low, high]) => format!(
                "{} x {} x {}, diagonal {}",
                short(high[0] - low[0]),
                short(high[1] - low[1]),
                short(high[2] - low[2]),
                short(self.diagonal)
            ),
            None => "nothing finite".to_string(),
        };
        for (name, fact) in [
            ("vertices", self.vertices.to_string()),
            ("triangles", self.faces.to_string()),
            ("size", size),
            ("area", short(self.area)),
            ("volume", self.volume.map_or("none".to_string(), short)),
            ("closed", yes(self.closed)),
            ("manifold edges", yes(self.edge_manifold)),
            ("manifold vertices", yes(self.vertex_manifold)),
            ("consistently oriented", yes(self.consistently_oriented)),
            (
                "facing outward",
                self.volume.map_or("-".to_string(), |_| yes(self.outward)),
            ),
            ("self-intersections", intersections),
        ] {
            writeln!(f, "  {name:<22} {fact}")?;
        }
        Ok(())
    }

    fn write_components(&self, f: &mut Formatter) -> fmt::Result {
        if self.components.is_empty() {
            return Ok(());
        }
        let columns = ["component", "triangles", "vertices", "genus", "area", "volume"];
        let [component, triangles, vertices, genus, area, volume] = columns;
        // A single one needs no place to be known by.
        let are_several = self.components.len() > 1;
        let places = if are_several {
            format!(" {:>32}", "centre")
        } else {
            String::new()
        };
        writeln!(
            f,
            "\n  {component:>9} {triangles:>10} {vertices:>10} {genus:>6} {area:>11} {volume:>11}{places}  bounds"
        )?;
        for (number, component) in self.components.iter().take(LISTED).enumerate() {
            writeln!(
                f,
                "  {number:>9} {:>10} {:>10} {:>6} {:>11} {:>11}{}  {}",
                component.faces,
                component.vertices,
                component.genus.map_or("-".to_string(), |genus| genus.to_string()),
                short(component.area),
                component.volume.map_or("-".to_string(), short),
                if are_several { place(component) } else { String::new() },
                bounds(component)
            )?;
        }
        match self.components.len().saturating_sub(LISTED) {
            0 => Ok(()),
            more => writeln!(f, "  ... and {more} more"),
        }
    }
}

fn place(component: &ComponentReport) -> String {
    let centre = component
        .centre
        .map_or("-".to_string(), |centre| centre.map(short).join(", "));
    format!(" {centre:>32}")
}

fn bounds(component: &ComponentReport) -> String {
    match (component.kind, component.inside) {
        (ComponentKind::NotAShell, _) => "nothing".to_string(),
        (ComponentKind::Solid, None) => "a solid".to_string(),
        (ComponentKind::Solid, Some(inside)) => format!("an island in cavity {inside}"),
        (ComponentKind::Cavity, Some(inside)) => format!("a cavity in {inside}"),
        (ComponentKind::Cavity, None) => "a cavity".to_string(),
    }
}

/// Four significant digits.
pub(super) fn short(x: f64) -> String {
    let magnitude = x.abs();
    if x == 0.0 {
        "0".to_string()
    } else if !(1e-3..1e6).contains(&magnitude) {
        format!("{x:.3e}")
    } else {
        let decimals = (3 - magnitude.log10().floor() as i32).max(0) as usize;
        format!("{x:.decimals$}")
    }
}
