//! How far to move a vertex along a Newton step.

/// Shares of the step that are tried until the energy falls, each this times the one before.
const MOST_SHORTENED: usize = 8;
const SHORTER: f64 = 0.4;
/// Longer steps are tried as long as the energy falls by this much of what its slope says: by the quadratic model it falls by
/// half of that.
const NEARLY_LINEAR: f64 = 0.6;
const LONGER: f64 = 2.5;
const LONGEST: f64 = 1e3;

/// Where the energy is lower than `before`. `at` gives the energy after a share of the step, and the place; `slope` is how fast the
/// energy falls at first, per step.
///
/// Newton's steps out of a narrow triangle are far too short: they are lengthened while the energy falls nearly as its slope says.
pub(super) fn lower_along<P>(before: f64, slope: f64, at: impl Fn(f64) -> Option<(f64, P)>) -> Option<P> {
    let lower = |share: f64| at(share).filter(|found| found.0 < before);
    let mut share = 1.0;
    let mut best = None;
    for _ in 0..MOST_SHORTENED {
        best = lower(share);
        if best.is_some() {
            break;
        }
        share *= SHORTER;
    }
    while let Some((value, _)) = best {
        if before - value < NEARLY_LINEAR * share * slope {
            break;
        }
        share *= LONGER;
        match lower(share) {
            Some(farther) if farther.0 < value && share < LONGEST => best = Some(farther),
            _ => break,
        }
    }
    best.map(|(_, place)| place)
}
