//! Springs on the universal cover: every vertex at the mean of its neighbours.
//!
//! On a torus the solution has no flipped triangles, whatever the surface (Gortler, Gotsman, Thurston, *Discrete one-forms on
//! meshes and applications to 3D mesh parameterization*, 2006).

use super::rings::{LiftedRings, Translations};
use crate::spherical::Cholesky;

/// The positions of these vertices, in units of the periods, with the first at the origin; 0 for all others. `None` when the
/// system does not fit into memory.
pub(super) fn springs(rings: &LiftedRings<Translations>, vertices: &[u32], count: usize) -> Option<Vec<[f64; 2]>> {
    let free = vertices.get(1..)?;
    let mut index = vec![u32::MAX; count];
    for (i, &v) in free.iter().enumerate() {
        index[v as usize] = i as u32;
    }
    let (mut begin, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    let mut columns = vec![0.0; 2 * free.len()];
    for (i, &v) in free.iter().enumerate() {
        let ring = rings.of(v);
        let neighbours = ring.iter().map(|r| index[r.0 as usize]);
        let mut later: Vec<u32> = neighbours.filter(|&j| j != u32::MAX && j > i as u32).collect();
        later.sort_unstable();
        rows.push(i as u32);
        values.push(ring.len() as f64);
        values.extend(later.iter().map(|_| -1.0));
        rows.extend(later);
        begin.push(rows.len() as u32);
        for axis in 0..2 {
            columns[axis * free.len() + i] = ring.iter().map(|r| f64::from(r.1[axis])).sum();
        }
    }
    let mut cholesky = Cholesky::new(begin, rows).ok()?;
    if !cholesky.factor(&values) {
        return None;
    }
    cholesky.solve(&mut columns);
    let mut positions = vec![[0.0; 2]; count];
    for (i, &v) in free.iter().enumerate() {
        positions[v as usize] = [columns[i], columns[free.len() + i]];
    }
    Some(positions)
}
