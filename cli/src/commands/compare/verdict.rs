//! The cost of equal accuracy by finite elements and by the method of fundamental solutions.

use super::Step;
use super::job::Figures;
use super::tables::{count, seconds};
use crate::shared::output::mebibytes;

/// Rms difference to the reference inside.
fn inside(figures: &Figures) -> f64 {
    figures.interior_difference.map_or(f64::NAN, |d| d.rms)
}

/// The cost of equal accuracy, in words.
pub fn verdict(steps: &[Step]) -> String {
    let of = |name: &str| {
        let rows = steps.iter().filter(move |step| step.row.name == name);
        rows.filter_map(|step| step.row.figures.as_ref()).collect::<Vec<_>>()
    };
    let (mfs, fem) = (of("mfs"), of("fem"));
    let (Some(mfs), Some(finest)) = (mfs.first(), fem.last()) else {
        return "No finite-element map could be made at equal accuracy.".into();
    };
    let goal = inside(mfs);
    let coarser = fem.len().checked_sub(2).map(|k| fem[k]);
    let own = format!(
        "mfs takes {} s and {:.0} MiB to come within {goal:.1e} rms of the reference inside, with a boundary error of \
         {:.1e} rms; finite elements have none at the boundary",
        seconds(mfs.total_seconds()),
        mebibytes(mfs.peak_rss_bytes),
        mfs.boundary_error.rms
    );
    if inside(finest) > goal {
        return format!(
            "Equal accuracy inside: {own}. Finite elements did not come as near within the budget: their finest mesh, \
             of {} tets, is {:.1e} away and takes {} s ({:.1} times; {:.1} times without meshing) and {:.0} MiB ({:.1} \
             times).",
            count(finest.tets),
            inside(finest),
            seconds(finest.total_seconds()),
            finest.total_seconds() / mfs.total_seconds(),
            (finest.total_seconds() - finest.seconds.mesh) / mfs.total_seconds(),
            mebibytes(finest.peak_rss_bytes),
            mebibytes(finest.peak_rss_bytes) / mebibytes(mfs.peak_rss_bytes)
        );
    }
    // Interpolated between the last two meshes: the cost as a power of the difference.
    let at_goal = |cost: &dyn Fn(&Figures) -> f64| match coarser {
        Some(coarser) if inside(coarser) > goal => {
            let part = (inside(coarser) / goal).ln() / (inside(coarser) / inside(finest)).ln();
            cost(coarser) * (cost(finest) / cost(coarser)).powf(part)
        }
        _ => cost(finest),
    };
    let tets = at_goal(&|f| f.tets.unwrap_or(1) as f64);
    let (time, memory) = (
        at_goal(&|figures| figures.total_seconds()),
        at_goal(&|f| mebibytes(f.peak_rss_bytes)),
    );
    let solving = at_goal(&|f| f.total_seconds() - f.seconds.mesh);
    format!(
        "Equal accuracy inside: {own}. Finite elements are as near with about {tets:.1e} tets, for {} s ({:.1} times; \
         {:.1} times without meshing) and {memory:.0} MiB ({:.1} times).",
        seconds(time),
        time / mfs.total_seconds(),
        solving / mfs.total_seconds(),
        memory / mebibytes(mfs.peak_rss_bytes)
    )
}
