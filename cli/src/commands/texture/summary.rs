//! The report on a texture, as JSON and in words.

use serde::Serialize;
use solidmap::fit::FitReport;
use solidmap::texture::{ColourError, ExtendedQuantity, SeamReport};

use crate::drawing::significant;
use crate::shared::chosen_map::MapName;
use crate::shared::json::FileName;
use crate::shared::output::{mebibytes, two_columns, written_row};

/// What `texture --json` prints.
#[derive(Serialize)]
pub struct TextureSummary {
    pub model: FileName,
    pub image: Option<FileName>,
    pub extended: ExtendedQuantity,
    pub fit: FitReport,
    /// Lowest and highest texture coordinates.
    pub uv_box: Option<[[f64; 2]; 2]>,
    pub seams: SeamReport,
    /// Error of the harmonic part alone on the surface.
    pub harmonic_error: Option<ColourError>,
    /// Error of the texture on the surface.
    pub surface_error: Option<ColourError>,
    /// Thickness of the layer that carries the difference, over the diagonal: median and largest.
    pub layer: [f64; 2],
    pub tolerance: Option<f64>,
    pub tolerance_met: Option<bool>,
    pub through: Option<ThroughSummary>,
    pub volume: Option<VolumeSummary>,
    pub points: Option<PointsSummary>,
    pub picture: Option<FileName>,
    pub page: Option<FileName>,
    pub map: Option<FileName>,
    pub seconds: TextureTimings,
    pub peak_rss_bytes: u64,
}

/// The map that the texture was carried through.
#[derive(Serialize)]
pub struct ThroughSummary {
    pub map: FileName,
    pub map_kind: MapName,
    /// Sampled points with several preimages, or an inverted one.
    pub folded: usize,
    /// Sampled points of the target for which no preimage was found.
    pub not_found: usize,
}

#[derive(Serialize)]
pub struct VolumeSummary {
    pub file: FileName,
    pub size: [usize; 3],
    pub spacing: f64,
    pub inside: usize,
    pub bytes: u64,
}

#[derive(Serialize)]
pub struct PointsSummary {
    pub file: FileName,
    pub points: usize,
    pub outside: usize,
}

#[derive(Serialize, Default)]
pub struct TextureTimings {
    pub texture: f64,
    pub measure: f64,
    pub volume: f64,
    pub points: f64,
    pub picture: f64,
}

/// The report as text.
pub fn text(report: &TextureSummary) -> String {
    let fit = &report.fit;
    let mut rows = vec![
        [
            "surface".into(),
            format!("{} vertices, {} triangles where it was fitted", fit.vertices, fit.faces),
        ],
        [
            "system".into(),
            format!("{} sources, {} collocation points", fit.sources, fit.collocation),
        ],
    ];
    if report.seams.seams > 0 {
        let seams = &report.seams;
        rows.push([
            "seams".into(),
            format!(
                "{} of {} edges; colours differ by {:.4} rms, {:.4} at most",
                seams.seams, seams.edges, seams.rms_colour_jump, seams.largest_colour_jump
            ),
        ]);
    }
    let errors = [
        ("harmonic part", &report.harmonic_error),
        ("texture", &report.surface_error),
    ];
    for (name, error) in errors {
        if let Some(error) = error {
            rows.push([
                name.into(),
                format!("rms {:.2e}   99 % {:.2e}   max {:.2e}", error.rms, error.p99, error.max),
            ]);
        }
    }
    rows.push([
        String::new(),
        "difference to the picture at held-out points of the surface, as light: 1 from black to white".into(),
    ]);
    let [median, most] = report.layer.map(|t| 100.0 * t);
    rows.push([
        "layer".into(),
        format!("{median:.2} % of the diagonal thick at the median, {most:.2} % at most"),
    ]);
    if let Some(through) = &report.through {
        let kind = match through.map_kind {
            MapName::Harmonic => "harmonic",
            MapName::Bijective => "bijective",
        };
        rows.push([
            "through".into(),
            format!(
                "`{}`, {kind}; {} points where it folds, {} without a preimage",
                through.map.display(),
                through.folded,
                through.not_found
            ),
        ]);
    }
    if let Some(volume) = &report.volume {
        let [x, y, z] = volume.size;
        rows.push([
            "volume".into(),
            format!(
                "{x} × {y} × {z} voxels of {}, {} inside, {:.1} MiB",
                significant(volume.spacing, 4),
                volume.inside,
                mebibytes(volume.bytes)
            ),
        ]);
    }
    if let Some(points) = &report.points {
        rows.push([
            "points".into(),
            format!("{}, {} outside", points.points, points.outside),
        ]);
    }
    let seconds = &report.seconds;
    rows.push([
        "time".into(),
        format!(
            "texture {:.2} s, volume {:.2} s, picture {:.2} s",
            seconds.texture, seconds.volume, seconds.picture
        ),
    ]);
    rows.push(written_row([
        report.volume.as_ref().map(|volume| &volume.file),
        report.points.as_ref().map(|points| &points.file),
        report.picture.as_ref(),
        report.page.as_ref(),
        report.map.as_ref(),
    ]));
    two_columns(rows)
}
