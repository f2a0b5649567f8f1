//! Triangles at two places, on a surface and where a map takes them: what pages of kind `boundary` show.

use anyhow::{Context, ensure};
use serde::Serialize;
use solidmap::Point;
use solidmap::boundary_map::{TriangleDistortion, triangle_distortions};
use solidmap::files::Provenance;
use solidmap::geometry::Axis;
use solidmap::mesh::SurfaceMesh;
use solidmap::statistics::quantiles;

use crate::args::{PageSizeArgs, UpKind};
use crate::shared::page::{Framing, NumberTable, PackedArray, Page, PageField, Palette, megabytes};

/// A surface and where a map takes it, to make a page of.
pub struct MappedSurface<'a> {
    /// The title.
    pub title: String,
    /// What the two are called.
    pub names: [&'static str; 2],
    /// The surface; it may be open.
    pub domain: &'a SurfaceMesh,
    /// Where each of its vertices goes.
    pub image: &'a [Point],
    /// For an image in the plane z = 0: lines to draw over it. It is seen from above, wherever the surface is seen from.
    pub outline: Option<Vec<[Point; 2]>>,
    /// Triangles whose images are inverted.
    pub flipped: &'a [u32],
    /// The files that both come from.
    pub files: Vec<Provenance>,
    /// What readers must know.
    pub notes: Vec<String>,
    /// Numbers of reports.
    pub tables: Vec<NumberTable>,
    /// What points up.
    pub up: UpKind,
}

/// What the scripts of the page read, besides the arrays.
#[derive(Serialize)]
struct BoundaryContent {
    kind: &'static str,
    names: [&'static str; 2],
    domain: Framing,
    target: Framing,
    fields: Vec<PageField>,
    /// Whether the image lies in a plane.
    flat: bool,
    up: (usize, bool),
}

impl MappedSurface<'_> {
    /// The text of the page, with all triangles.
    pub fn html(self, args: &PageSizeArgs) -> anyhow::Result<String> {
        let Self { domain, image, up, .. } = self;
        let (fields, mut arrays) = distortions(domain, image)?;
        let (framing, target_framing) = (Framing::of(domain.vertices()), Framing::of(image));
        let triangles = domain.triangles();
        arrays.push(PackedArray::floats("domain", framing.place(domain.vertices())));
        arrays.push(PackedArray::floats("image", target_framing.place(image)));
        arrays.push(PackedArray::indices("triangles", triangles.iter().flatten().copied()));
        arrays.push(PackedArray::indices("flipped", self.flipped.iter().copied()));
        if let Some(lines) = &self.outline {
            arrays.push(PackedArray::floats(
                "outline",
                target_framing.place(lines.iter().flatten()),
            ));
        }
        let page = Page {
            title: self.title,
            files: self.files,
            notes: self.notes,
            tables: self.tables,
            arrays,
        };
        let content = BoundaryContent {
            kind: "boundary",
            names: self.names,
            domain: framing,
            target: target_framing,
            fields,
            flat: self.outline.is_some(),
            up: (Axis::from(up).index(), up.is_upside_down()),
        };
        let html = page.html(&content)?;
        let size = html.len() as u64;
        ensure!(
            size <= args.max_size,
            "the page of all {} triangles takes {:.1} MB, but --max-size is {:.1} MB; allow more",
            triangles.len(),
            megabytes(size),
            megabytes(args.max_size)
        );
        Ok(html)
    }
}

/// How far each triangle is from being mapped by a similarity, with arrays of the values.
fn distortions(domain: &SurfaceMesh, image: &[Point]) -> anyhow::Result<(Vec<PageField>, Vec<PackedArray>)> {
    let triangles = triangle_distortions(domain, image);
    let triangles = triangles.context("the image has another number of vertices than the domain")?;
    let values = |of: fn(&TriangleDistortion) -> f64| -> Vec<f64> {
        let value = |triangle: &Option<TriangleDistortion>| triangle.as_ref().map_or(f64::NAN, of);
        triangles.iter().map(value).collect()
    };
    let (area, angle) = (
        values(TriangleDistortion::area_ratio),
        values(TriangleDistortion::angle),
    );
    let [few, most] = quantiles(&area, [0.01, 0.99]).unwrap_or([1.0; 2]);
    let factor = most.max(1.0 / few.max(f64::MIN_POSITIVE)).clamp(1.25, 32.0);
    let [widest] = quantiles(&angle, [0.99]).unwrap_or([2.0]);
    let fields = vec![
        PageField {
            key: "area".into(),
            label: "area ratio".into(),
            unit: "×",
            meaning: "σ₁σ₂, area of a triangle's image over its own, with both surfaces scaled to one area".into(),
            palette: Palette::Ratio,
            logarithmic: true,
            low: 1.0 / factor,
            high: factor,
            clamps: area.iter().any(|ratio| *ratio < 1.0 / factor || *ratio > factor),
        },
        PageField {
            key: "angle".into(),
            label: "σ₁ / σ₂".into(),
            unit: "×",
            meaning: "σ₁ / σ₂, largest stretch of a triangle over the smallest: 1 where angles are kept".into(),
            palette: Palette::Amount,
            logarithmic: false,
            low: 1.0,
            high: widest.clamp(1.05, 1e6),
            clamps: angle.iter().any(|value| *value > widest),
        },
    ];
    let arrays = vec![
        PackedArray::floats("field-area", area),
        PackedArray::floats("field-angle", angle),
    ];
    Ok((fields, arrays))
}
