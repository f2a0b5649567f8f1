//! The page of a surface that is laid out in the plane: the surface, cut open, and its layout.

use std::path::Path;

use solidmap::Point;
use solidmap::boundary_map::FundamentalDomain;
use solidmap::mesh::SurfaceMesh;

use crate::args::{PageSizeArgs, UpKind};
use crate::drawing::significant;
use crate::shared::boundary_page::MappedSurface;
use crate::shared::input;
use crate::shared::page::NumberTable;

/// A layout to make a page of.
pub struct UnfoldPage<'a> {
    /// The model's file.
    pub path: &'a Path,
    /// The surface, and the polygon.
    pub domain: &'a FundamentalDomain,
    /// The surface with the vertices of the layout.
    pub cut: &'a SurfaceMesh,
    /// The layout.
    pub layout: &'a SurfaceMesh,
    /// Ratios of the stretches over half and 99 % of the area.
    pub angles: [f64; 2],
    /// What points up.
    pub up: UpKind,
}

impl UnfoldPage<'_> {
    /// The text of the page.
    pub fn html(self, args: &PageSizeArgs) -> anyhow::Result<String> {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let domain = self.domain;
        let polygon = match domain.genus {
            1 => "a parallelogram".into(),
            _ => format!("a polygon of {} sides", domain.sides.len()),
        };
        let surface = MappedSurface {
            title: format!("{name}: laid out in {polygon}"),
            names: ["surface", "layout"],
            domain: self.cut,
            image: self.layout.vertices(),
            outline: Some(outline(&domain.sides)),
            // Every triangle of a layout is positive.
            flipped: &[],
            files: vec![input::provenance("model", self.path)?],
            notes: notes(domain.genus),
            tables: vec![self.numbers()],
            up: self.up,
        };
        surface.html(args)
    }

    fn numbers(&self) -> NumberTable {
        let (domain, [half, most]) = (self.domain, self.angles);
        let mut table = NumberTable::new("Layout");
        let mut count = |name: &str, number: usize, meaning: &str| table.row(name, number.to_string(), "", meaning);
        count("genus", domain.genus as usize, "handles of the surface");
        count("sides", domain.sides.len(), "of the polygon, glued in pairs");
        count("vertices", domain.surface.vertices().len(), "of the surface");
        count("triangles", domain.surface.triangles().len(), "of the surface");
        count(
            "vertices of the layout",
            self.layout.vertices().len(),
            "those of the surface, and copies where it is cut",
        );
        let mut angle = |name: &str, value: f64, meaning: &str| table.row(name, significant(value, 4), "×", meaning);
        angle(
            "σ₁ / σ₂, median",
            half,
            "largest stretch of a triangle over the smallest, over half of the area: 1 where angles are kept",
        );
        angle("σ₁ / σ₂, 99 %", most, "the same over 99 % of the area");
        table
    }
}

/// The sides of the polygon, as lines.
fn outline(sides: &[Vec<[f64; 2]>]) -> Vec<[Point; 2]> {
    let point = |[x, y]: [f64; 2]| Point::new(x, y, 0.0);
    let lines = sides.iter().flat_map(|side| side.windows(2));
    lines.map(|ends| [point(ends[0]), point(ends[1])]).collect()
}

fn notes(genus: u64) -> Vec<String> {
    let mut notes = vec![
        "The surface is cut open where sides of the polygon are glued. Triangles across a side are drawn once: they stick out, \
         and may come loose."
            .to_owned(),
    ];
    if genus > 1 {
        notes.push(
            "The polygon lies in Poincaré's disk, which keeps angles and shows areas the smaller the nearer they are to its edge. \
             Area ratios are those of the drawing."
                .into(),
        );
    }
    notes
}
