//! A field on cross-sections of domain and target, and all scalar fields in a page.

use anyhow::{Context, ensure};
use solidmap::Point;
use solidmap::boundary_map::BoundaryMap;
use solidmap::energy::EnergyOptions;
use solidmap::files::MapMetadata;
use solidmap::geometry::PlaneSection;
use solidmap::inverse::{Inverse, PreimageStatus};
use solidmap::transfer::{FieldKind, FieldMesh, FieldSampler};

use super::fields::{all_fields, distances, is_distance};
use crate::args::TransferArgs;
use crate::drawing::{ColourBar, Figure, Panel, Scale, ValueRange};
use crate::shared::chosen_map::ChosenMap;
use crate::shared::map_page::{CarriedScalar, MapPage, measured};
use crate::shared::output::Output;

/// Pixels along the longer side of a section.
const SECTION_PIXELS: usize = 480;

/// The largest value in a page, which has single precision.
const MOST: f64 = 1e30;

/// The page of the map with every scalar field.
pub fn page(
    args: &TransferArgs,
    chosen: ChosenMap,
    boundary: &BoundaryMap,
    metadata: &MapMetadata,
    carrier: &FieldMesh,
    output: &Output,
) -> anyhow::Result<String> {
    output.progress("integrating");
    let options = EnergyOptions::default();
    let energy = measured(chosen, boundary, &options)
        .with_context(|| format!("cannot measure `{}` for the page", args.map.display()))?;
    let sampler = FieldSampler::new(carrier)?;
    let scalars = |points: &[Point]| -> anyhow::Result<Vec<CarriedScalar>> {
        let scalars = sampler.sample(points).0.into_iter();
        let scalars = scalars.filter(|field| field.components == 1).map(|field| {
            let values = match is_distance(args, &field) {
                true => distances(boundary, points)?,
                false => field.values,
            };
            let shown = field.name.escape_debug();
            let most = values.iter().filter(|v| v.is_finite()).map(|v| v.abs()).fold(f64::NAN, f64::max);
            ensure!(
                !most.is_nan(),
                "`{shown}` has no finite value in the domain, and cannot be shown; leave out --html, or the field"
            );
            ensure!(
                most <= MOST,
                "`{shown}` has values of up to {most:.1e}, and a page holds numbers of up to {MOST:.0e}; scale the field"
            );
            Ok(CarriedScalar {
                is_label: field.kind == FieldKind::Label,
                name: field.name,
                values,
            })
        });
        scalars.collect()
    };
    let page = MapPage {
        path: &args.map,
        chosen,
        boundary,
        metadata,
        energy: &energy,
        options,
        up: args.section.up,
        certificate: None,
        carried: Some(&scalars),
    };
    Ok(page.make(&args.page, output)?.html)
}

/// Cross-sections of domain and target in the colours of one bar, as a PNG.
pub fn draw(
    which: usize,
    args: &TransferArgs,
    boundary: &BoundaryMap,
    inverse: &dyn Inverse,
    carrier: &FieldMesh,
) -> anyhow::Result<Vec<u8>> {
    let (_, field) = all_fields(carrier).nth(which).context("there is no such field")?;
    let sampler = FieldSampler::new(carrier)?;
    let values_at = |points: &[Point]| -> anyhow::Result<Vec<f64>> {
        Ok(match is_distance(args, field) {
            true => distances(boundary, points)?,
            false => sampler.sample(points).0.swap_remove(which).values,
        })
    };
    let target = boundary.outward_target();
    let plane = args.section.plane(boundary.domain());
    let of_domain = PlaneSection::new(boundary.domain(), plane, args.section.up.into(), SECTION_PIXELS)?;
    let target_up = args.target_up.or(args.section.up);
    let of_target = PlaneSection::new(&target, args.section.plane(&target), target_up.into(), SECTION_PIXELS)?;
    let before = values_at(of_domain.points())?;
    let (preimages, _) = inverse.preimages(of_target.points());
    let places: Vec<Point> = preimages
        .iter()
        .map(|preimage| match preimage.status {
            PreimageStatus::NotFinite => Point::from([f64::NAN; 3]),
            // Pixels at the rim may have no preimage; this is a point whose image is near.
            _ => preimage.point,
        })
        .collect();
    let after = values_at(&places)?;
    let all = before.iter().chain(&after).copied();
    let bar = ColourBar::new(&field.name, all, ValueRange::Quantiles(0.0, 1.0), Scale::Linear)?
        .in_colours(args.section.colours());
    let domain = Panel::of_section(&of_domain, &before, &bar)?
        .turned_if(args.section.up.is_upside_down())
        .titled("domain")
        .with_bar(&bar);
    let target = Panel::of_section(&of_target, &after, &bar)?
        .turned_if(target_up.is_upside_down())
        .titled("target")
        .with_bar(&bar);
    Ok(Figure::row(vec![domain, target]).to_png()?)
}
