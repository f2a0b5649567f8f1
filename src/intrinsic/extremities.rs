//! Tips of limbs: persistent maxima of the average geodesic distance.
//!
//! Hilaga, Shinagawa, Kohmura, Kunii, *Topology matching for fully automatic similarity estimation of 3D shapes*, 2001,
//! for the function; Edelsbrunner, Letscher, Zomorodian, *Topological persistence and simplification*, 2002.

use super::heat::HeatMethod;
use super::laplacian::Neighbours;

/// Points, each farthest from those before, that the distances are averaged over.
const SITES: usize = 40;
/// Maxima of smaller persistence are no tips: those of limbs have 0.16 or more, the next ones 0.04 or less.
const LEAST_PERSISTENCE: f64 = 0.05;
/// The most extremities of a surface.
pub(super) const MOST_EXTREMITIES: usize = 12;

/// A tip of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extremity {
    /// The vertex there.
    pub vertex: u32,
    /// By how much the average geodesic distance, in units of the square root of the area, falls on every way to a
    /// higher maximum; for the highest, to the minimum.
    pub persistence: f64,
}

/// The mean distance of every vertex from well-spread ones. `None` when `proceed` says no.
pub(super) fn average_distances(
    heat: &HeatMethod,
    start: u32,
    proceed: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<f64>> {
    let mut nearest = heat.distances(start);
    let mut sums = vec![0.0; nearest.len()];
    for site in 0..SITES {
        if !proceed() {
            return None;
        }
        // The first site is the vertex farthest from the start, which is none.
        let next = highest(&nearest);
        let distances = heat.distances(next);
        if site == 0 {
            nearest.copy_from_slice(&distances);
        }
        for ((sum, nearest), distance) in sums.iter_mut().zip(&mut nearest).zip(&distances) {
            *sum += distance / SITES as f64;
            *nearest = nearest.min(*distance);
        }
    }
    Some(sums)
}

/// The persistent maxima of a function, the most persistent first.
pub(super) fn extremities(function: &[f64], neighbours: &Neighbours) -> Vec<Extremity> {
    let mut order: Vec<u32> = (0..function.len() as u32).collect();
    let value = |v: u32| function[v as usize];
    order.sort_by(|&a, &b| value(b).total_cmp(&value(a)).then(a.cmp(&b)));
    // Components of the set above the current value, each known by its maximum.
    let mut parents: Vec<u32> = vec![u32::MAX; function.len()];
    let mut found = Vec::new();
    for &v in &order {
        parents[v as usize] = v;
        for &other in neighbours.of(v) {
            if parents[other as usize] == u32::MAX {
                continue;
            }
            let [a, b] = [v, other].map(|x| maximum(&mut parents, x));
            if a == b {
                continue;
            }
            let is_first_higher = value(a) > value(b) || (value(a) == value(b) && a < b);
            let (high, low) = if is_first_higher { (a, b) } else { (b, a) };
            parents[low as usize] = high;
            found.push((low, value(low) - value(v)));
        }
    }
    if let (Some(&first), Some(&last)) = (order.first(), order.last()) {
        found.push((first, value(first) - value(last)));
    }
    found.retain(|&(_, persistence)| persistence > LEAST_PERSISTENCE);
    found.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    found.truncate(MOST_EXTREMITIES);
    found
        .into_iter()
        .map(|(vertex, persistence)| Extremity { vertex, persistence })
        .collect()
}

/// The maximum of a vertex's component; paths are halved.
fn maximum(parents: &mut [u32], mut v: u32) -> u32 {
    while parents[v as usize] != v {
        let parent = parents[v as usize];
        parents[v as usize] = parents[parent as usize];
        v = parent;
    }
    v
}

pub(super) fn highest(values: &[f64]) -> u32 {
    let best = (0..values.len()).fold(0, |best, v| if values[v] > values[best] { v } else { best });
    best as u32
}
