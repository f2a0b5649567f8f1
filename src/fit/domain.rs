use super::FitError;
use crate::check;
use crate::mesh::SurfaceMesh;

/// The domain with its faces oriented outward, and warnings about it.
pub(super) fn checked(domain: &SurfaceMesh) -> Result<(SurfaceMesh, Vec<String>), FitError> {
    let diagonal = domain.diagonal();
    // The check says more about a surface that has no extent or is not finite.
    if diagonal > 0.0 && diagonal.is_finite() && !(1e-60..=1e60).contains(&diagonal) {
        return Err(FitError::OutOfScale { diagonal });
    }
    let report = check::check(domain, None);
    if !report.is_solvable() {
        return Err(FitError::DefectiveDomain(Box::new(report)));
    }
    let (repaired, repairs) = check::repair(domain);
    let warnings = report.warnings().map(|finding| finding.message.clone());
    let warnings = warnings.chain(repairs.iter().map(ToString::to_string)).collect();
    Ok((repaired, warnings))
}
