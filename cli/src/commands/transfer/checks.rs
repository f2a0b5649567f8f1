//! How the map changes volumes, and the distribution of each field.

use anyhow::Context;
use serde::Serialize;
use solidmap::boundary_map::BoundaryMap;
use solidmap::energy::{GridResolution, clipped_grid};
use solidmap::map::VolumeMap;
use solidmap::transfer::{
    DistributionCheck, FieldKind, FieldMesh, FieldSampler, LabelShare, VolumeCheck, distribution_check, label_shares,
    volume_check,
};

use super::fields::{all_fields, distances, is_distance, shown};
use crate::args::TransferArgs;
use crate::shared::points::is_table;

#[derive(Serialize)]
pub struct FieldSummary {
    pub name: String,
    pub components: usize,
    /// `point` or `cell`.
    pub over: &'static str,
    /// `values`, `vector` or `label`.
    pub carry: &'static str,
    /// Whether the output has it: a table holds no cell data.
    pub written: bool,
    /// For fields of one component that are not labels.
    pub distribution: Option<DistributionCheck>,
    pub labels: Option<Vec<LabelShare>>,
}

pub struct TransferChecks {
    pub volume: VolumeCheck,
    pub volume_beyond_field: f64,
    pub fields: Vec<FieldSummary>,
}

pub fn check(
    args: &TransferArgs,
    map: &dyn VolumeMap,
    boundary: &BoundaryMap,
    carrier: &FieldMesh,
) -> anyhow::Result<TransferChecks> {
    let quadrature = clipped_grid(
        boundary.domain(),
        GridResolution::CellsAlongLongestSide(args.resolution),
    )?;
    let (volume, after) = volume_check(map, &quadrature, boundary.target_volume());
    let sampler = FieldSampler::new(carrier).with_context(|| format!("cannot carry `{}`", shown(args)))?;
    let (mut fields, beyond) = sampler.sample(quadrature.points());
    for field in &mut fields {
        if is_distance(args, field) {
            field.values = distances(boundary, quadrature.points())?;
            continue;
        }
        let rows = field.values.chunks_mut(field.components.max(1)).zip(&beyond);
        rows.filter(|(_, beyond)| **beyond)
            .for_each(|(row, _)| row.fill(f64::NAN));
    }
    let beyond: Vec<f64> = beyond.iter().map(|&beyond| f64::from(u8::from(beyond))).collect();
    let has_field = args.field.is_some();
    let before = quadrature.weights();
    let reports = all_fields(carrier).zip(&fields).map(|((over, _), field)| FieldSummary {
        name: field.name.clone(),
        components: field.components,
        over,
        carry: match field.kind {
            FieldKind::Values => "values",
            FieldKind::Vector => "vector",
            FieldKind::Label => "label",
        },
        written: over == "point" || args.at.is_some() || !is_table(&args.output),
        distribution: (field.components == 1 && field.kind != FieldKind::Label)
            .then(|| distribution_check(&field.values, before, &after))
            .flatten(),
        labels: (field.components == 1 && field.kind == FieldKind::Label)
            .then(|| label_shares(&field.values, before, &after)),
    });
    Ok(TransferChecks {
        volume,
        volume_beyond_field: if has_field {
            quadrature.integrate(&beyond) / quadrature.volume()
        } else {
            0.0
        },
        fields: reports.collect(),
    })
}
