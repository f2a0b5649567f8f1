//! The planes of a polycube on a lattice, so that a regular mesh has boxes of one size and no thin ones between planes that are
//! close.
//!
//! Each plane gets a whole number of cells as its coordinate: the weighted sum of squares by which planes move is minimised
//! while planes that face each other keep their order and at least a cell between them.

use std::collections::HashMap;

use super::solid::Solid;
use crate::Vector;
use crate::mesh::topology::DisjointSets;
use crate::remesh::{Polycube, SharedCoordinates};

/// Offsets of the lattice that are tried along each axis, over a cell.
const OFFSETS: usize = 8;
/// Cells between a plane and the origin: whole numbers stay far from overflow, and no mesh has as many.
const MOST_CELLS: f64 = 1e9;
/// Sweeps of averages that spread the shifts of planes over the other nodes.
const SWEEPS: usize = 150;

/// Plane sets, one below the other: they stay apart by a cell at least.
type Order = [u32; 2];

/// The coordinate of each set of `planes` on a lattice with cells of `size`. With `keeps_distance`, planes also keep their
/// order that would face each other if they were wider by a cell. `None` if the polycube's faces are not those of the
/// planes, or the cells are far too small.
pub(super) fn on_lattice(
    solid: &Solid,
    polycube: &Polycube,
    planes: &SharedCoordinates,
    size: f64,
    keeps_distance: bool,
) -> Option<Vec<f64>> {
    let margin = if keeps_distance { size } else { 0.0 };
    let covered = covered_points(solid, polycube, planes, margin)?;
    let areas = areas(solid, planes);
    let mut coordinates = vec![0.0; planes.equal.len()];
    for axis in 0..3 {
        let sets: Vec<usize> = (0..planes.equal.len())
            .filter(|&set| planes.equal[set].0 == axis)
            .collect();
        let at: Vec<f64> = sets
            .iter()
            .map(|&set| Some(solid.x[*planes.equal[set].1.first()? as usize][axis] / size))
            .collect::<Option<_>>()?;
        if at.iter().any(|at| at.is_nan() || at.abs() > MOST_CELLS) {
            return None;
        }
        let weights: Vec<f64> = sets.iter().map(|&set| areas[set]).collect();
        let orders = orders(&sets, &at, &covered);
        let offset = |k: usize| k as f64 / OFFSETS as f64;
        let solutions = (0..OFFSETS).map(|k| {
            let targets: Vec<f64> = at.iter().map(|at| at - offset(k)).collect();
            let found = whole_numbers(&targets, &weights, &orders);
            let cost: f64 = (0..found.len())
                .map(|i| weights[i] * (found[i] as f64 - targets[i]).powi(2))
                .sum();
            (cost, found)
        });
        let (_, best) = solutions.min_by(|a, b| a.0.total_cmp(&b.0))?;
        for (&set, k) in sets.iter().zip(best) {
            coordinates[set] = k as f64 * size;
        }
    }
    Some(coordinates)
}

/// Moves the planes to these coordinates, and the other nodes along with them.
pub(super) fn move_planes(solid: &mut Solid, planes: &SharedCoordinates, coordinates: &[f64]) {
    let mut is_fixed = vec![[false; 3]; solid.x.len()];
    let mut shifts = vec![Vector::zeros(); solid.x.len()];
    for ((axis, nodes), to) in planes.equal.iter().zip(coordinates) {
        for &v in nodes {
            is_fixed[v as usize][*axis] = true;
            shifts[v as usize][*axis] = to - solid.x[v as usize][*axis];
        }
    }
    let mut neighbours: Vec<Vec<u32>> = vec![vec![]; solid.x.len()];
    for tet in solid.tets() {
        for &a in tet {
            neighbours[a as usize].extend(tet.iter().filter(|&&b| b != a));
        }
    }
    for list in &mut neighbours {
        list.sort_unstable();
        list.dedup();
    }
    for _ in 0..SWEEPS {
        for (v, around) in neighbours.iter().enumerate().filter(|(_, around)| !around.is_empty()) {
            let mean = around.iter().map(|&b| shifts[b as usize]).sum::<Vector>() / around.len() as f64;
            (0..3)
                .filter(|&axis| !is_fixed[v][axis])
                .for_each(|axis| shifts[v][axis] = mean[axis]);
        }
    }
    for (p, shift) in solid.x.iter_mut().zip(shifts) {
        *p += shift;
    }
    // Not by adding: these are the same for all nodes of a plane, bit for bit.
    for ((axis, nodes), to) in planes.equal.iter().zip(coordinates) {
        nodes.iter().for_each(|&v| solid.x[v as usize][*axis] = *to);
    }
}

/// The area of each plane, in the model.
fn areas(solid: &Solid, planes: &SharedCoordinates) -> Vec<f64> {
    let set_at = set_at(solid, planes);
    let mut areas = vec![0.0; planes.equal.len()];
    for (corners, label) in solid.mesh.boundary.iter().zip(solid.labels()) {
        let [a, b, c] = corners.map(|v| solid.mesh.nodes[v as usize]);
        if let Some(set) = set_at(corners[0], label) {
            areas[set] += 0.5 * (b - a).cross(&(c - a)).norm();
        }
    }
    areas
}

/// The set of a node along the axis of a label.
fn set_at(solid: &Solid, planes: &SharedCoordinates) -> impl Fn(u32, u8) -> Option<usize> {
    let mut sets = vec![[u32::MAX; 3]; solid.x.len()];
    for (set, (axis, nodes)) in (0..).zip(&planes.equal) {
        nodes.iter().for_each(|&v| sets[v as usize][*axis] = set);
    }
    move |v, label| {
        let set = sets[v as usize][super::axis_of(label)];
        (set != u32::MAX).then_some(set as usize)
    }
}

/// For each set, which points of the grid of the polycube's planes across the two other axes it covers, ascending.
fn covered_points(
    solid: &Solid,
    polycube: &Polycube,
    planes: &SharedCoordinates,
    margin: f64,
) -> Option<Vec<Vec<[u32; 2]>>> {
    // A face of a box: axis, side, plane, and place in the plane.
    type Face = (usize, usize, usize, [usize; 2]);
    let mut numbers: HashMap<Face, u32> = HashMap::new();
    let mut faces: Vec<Face> = vec![];
    for at in polycube.filled() {
        for [axis, side] in polycube.outer_faces_of(at) {
            let face = (axis, side, at[axis] + side, [at[(axis + 1) % 3], at[(axis + 2) % 3]]);
            numbers.insert(face, faces.len() as u32);
            faces.push(face);
        }
    }
    let mut parts = DisjointSets::new(faces.len());
    for (number, &(axis, side, plane, [b, c])) in (0..).zip(&faces) {
        for beside in [[b + 1, c], [b, c + 1]] {
            if let Some(&other) = numbers.get(&(axis, side, plane, beside)) {
                parts.unite(number, other);
            }
        }
    }
    // Which set a part belongs to is seen at the centres of its triangles.
    let set_at = set_at(solid, planes);
    let mut set_of_part = vec![u32::MAX; faces.len()];
    for (corners, label) in solid.mesh.boundary.iter().zip(solid.labels()) {
        let axis = super::axis_of(label);
        let set = set_at(corners[0], label)?;
        let p = corners.map(|v| solid.x[v as usize]);
        let centre = (p[0].coords + p[1].coords + p[2].coords) / 3.0;
        let [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
        let interval = |k: usize, at: f64| polycube.planes()[k].partition_point(|&x| x <= at).checked_sub(1);
        let place = [interval(b, centre[b])?, interval(c, centre[c])?];
        let across = &polycube.planes()[axis];
        let after = across.partition_point(|&x| x < centre[axis]);
        let nearest = (after.saturating_sub(1)..=after.min(across.len() - 1)).min_by(|&i, &j| {
            (across[i] - centre[axis])
                .abs()
                .total_cmp(&(across[j] - centre[axis]).abs())
        })?;
        let &face = numbers.get(&(axis, usize::from(label % 2), nearest, place))?;
        let part = parts.find(face) as usize;
        if set_of_part[part] != u32::MAX && set_of_part[part] != set as u32 {
            return None;
        }
        set_of_part[part] = set as u32;
    }
    let mut covered = vec![vec![]; planes.equal.len()];
    for (number, &(axis, _, _, place)) in (0..).zip(&faces) {
        let set = set_of_part[parts.find(number) as usize];
        if set == u32::MAX {
            return None;
        }
        let around = [0, 1].map(|k| {
            let lines = &polycube.planes()[(axis + 1 + k) % 3];
            let first = lines.partition_point(|&x| x < lines[place[k]] - margin);
            first as u32..lines.partition_point(|&x| x <= lines[place[k] + 1] + margin) as u32
        });
        let [first, second] = around;
        covered[set as usize].extend(first.flat_map(|i| second.clone().map(move |j| [i, j])));
    }
    for points in &mut covered {
        points.sort_unstable();
        points.dedup();
    }
    Some(covered)
}

/// Pairs among `sets`, planes across one axis at `at`, that cover a common point; by their places in `sets`.
fn orders(sets: &[usize], at: &[f64], covered: &[Vec<[u32; 2]>]) -> Vec<Order> {
    let mut orders = vec![];
    for i in 0..sets.len() {
        for j in 0..sets.len() {
            if at[i] < at[j] && have_common(&covered[sets[i]], &covered[sets[j]]) {
                orders.push([i as u32, j as u32]);
            }
        }
    }
    orders
}

/// Whether two ascending lists have a common element.
fn have_common(a: &[[u32; 2]], b: &[[u32; 2]]) -> bool {
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        match a[i].cmp(&b[j]) {
            std::cmp::Ordering::Less => i += 1,
            std::cmp::Ordering::Greater => j += 1,
            std::cmp::Ordering::Equal => return true,
        }
    }
    false
}

/// Whole numbers near `targets` of which the first of each order is less than the second. From a solution that keeps the
/// orders, a number is moved by one, with those that it pushes along, as long as that lowers the weighted sum of squares.
fn whole_numbers(targets: &[f64], weights: &[f64], orders: &[Order]) -> Vec<i64> {
    let count = targets.len();
    let (mut above, mut below) = (vec![vec![]; count], vec![vec![]; count]);
    for &[low, high] in orders {
        above[low as usize].push(high as usize);
        below[high as usize].push(low as usize);
    }
    let mut ascending: Vec<usize> = (0..count).collect();
    ascending.sort_by(|&i, &j| targets[i].total_cmp(&targets[j]));
    let mut numbers = vec![i64::MIN; count];
    for i in ascending {
        let least = below[i].iter().map(|&j| numbers[j] + 1).max().unwrap_or(i64::MIN);
        numbers[i] = least.max(targets[i].round() as i64);
    }
    loop {
        let mut is_better = false;
        for i in 0..count {
            for (step, pushed) in [(1, &above), (-1, &below)] {
                // Those that have to move along.
                let (mut moved, mut next) = (vec![i], 0);
                while next < moved.len() {
                    let from = moved[next];
                    for &j in &pushed[from] {
                        if numbers[j] == numbers[from] + step && !moved.contains(&j) {
                            moved.push(j);
                        }
                    }
                    next += 1;
                }
                let cost = |j: &usize, number: i64| weights[*j] * (number as f64 - targets[*j]).powi(2);
                let gain: f64 = moved
                    .iter()
                    .map(|j| cost(j, numbers[*j]) - cost(j, numbers[*j] + step))
                    .sum();
                let size: f64 = moved.iter().map(|j| cost(j, numbers[*j])).sum();
                // More than a rounding error, so that this ends.
                if gain > 1e-12 * size {
                    moved.iter().for_each(|&j| numbers[j] += step);
                    is_better = true;
                }
            }
        }
        if !is_better {
            return numbers;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_order_and_are_the_nearest_there_are() {
        // By trying all numbers.
        let best = |targets: &[f64], weights: &[f64], orders: &[Order]| -> f64 {
            let count = targets.len();
            let mut least = f64::INFINITY;
            for code in 0..7usize.pow(count as u32) {
                let number = |i: usize| (code / 7usize.pow(i as u32) % 7) as f64 - 2.0;
                if orders.iter().all(|&[i, j]| number(i as usize) < number(j as usize)) {
                    least = least.min((0..count).map(|i| weights[i] * (number(i) - targets[i]).powi(2)).sum());
                }
            }
            least
        };
        let mut next = super::super::face_graph::shapes::numbers(7);
        let (mut same, mut cases) = (0, 0);
        for _ in 0..60 {
            let mut value = |scale: f64| next(1 << 20) as f64 / f64::from(1 << 20) * scale;
            let targets: Vec<f64> = (0..5).map(|_| value(2.5)).collect();
            let weights: Vec<f64> = (0..5).map(|_| 0.1 + value(1.0)).collect();
            let mut orders = vec![];
            for i in 0..5u32 {
                for j in 0..5u32 {
                    if targets[i as usize] < targets[j as usize] && value(1.0) < 0.4 {
                        orders.push([i, j]);
                    }
                }
            }
            let found = whole_numbers(&targets, &weights, &orders);
            assert!(orders.iter().all(|&[i, j]| found[i as usize] < found[j as usize]));
            let cost: f64 = (0..5)
                .map(|i| weights[i] * (found[i] as f64 - targets[i]).powi(2))
                .sum();
            let least = best(&targets, &weights, &orders);
            assert!(cost >= least - 1e-12 && cost < 1.5 * least + 1e-12, "{cost} {least}");
            same += usize::from(cost < least + 1e-9);
            cases += 1;
        }
        assert!(same * 10 >= cases * 9, "{same} of {cases}");
    }
}
