//! Reference cells of their own sizes: for each cell its shape in the domain, as large as the cells around it are in
//! the image. A mesh that is graded, or that the map scales here and there, is not pulled towards cells of one size.

use rayon::prelude::*;

use super::bounded_mesh::BoundedMesh;
use super::foldover::{FoldoverEnergy, SLIVER, edges, length_or_one, regular_edges};
use super::quality::{HEX_CORNERS, tet_scaled_jacobians};
use crate::mesh::CellList;
use crate::{Matrix3, Point};

/// Passes of averaging from cells to nodes and back.
const PASSES: usize = 3;
/// Edges of a hexahedron along each axis of its box.
pub(super) const HEX_EDGES: [[[usize; 2]; 4]; 3] = [
    [[0, 1], [3, 2], [4, 5], [7, 6]],
    [[0, 3], [1, 2], [4, 7], [5, 6]],
    [[0, 4], [1, 5], [2, 6], [3, 7]],
];

/// The shape of a reference cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OwnShape {
    /// That of the cell in the domain: a tetrahedron unless it is a sliver or inverted; for a hexahedron a box with the
    /// mean lengths of its edges.
    Given,
    /// A regular tetrahedron, a cube.
    Regular,
    /// For a hexahedron a box between a cube and one with the mean lengths of its edges in the image; for a tetrahedron a
    /// regular one. Cells may stay as long and thin as they are, as long as their angles are right.
    Imaged,
}

/// The energy of the cells `some`, or of all, relative to cells of their own sizes with the nodes at `x`. All cells
/// count the same, however small.
///
/// The ratio of volumes in the image to those in the domain is averaged over some rings of cells, so that flat and
/// inverted cells get the size of their neighbours.
pub(super) fn own_size_energy(
    mesh: &BoundedMesh,
    x: &[Point],
    shape: OwnShape,
    some: Option<&[u32]>,
) -> FoldoverEnergy {
    let nodes = x.len();
    let chosen: Vec<u32> = match some {
        Some(cells) => cells.to_vec(),
        None => (0..mesh.cells.len() as u32).collect(),
    };
    match &mesh.cells {
        CellList::Tets(tets) => {
            let quality = tet_scaled_jacobians(tets, &mesh.nodes);
            let volume = |t: &[u32; 4], at: &[Point]| edges(t.map(|v| at[v as usize])).determinant() / 6.0;
            // Volumes of slivers say nothing; they get the size of their neighbours.
            let mut own: Vec<f64> = (tets.par_iter().zip(&quality))
                .map(|(t, &quality)| if quality > SLIVER { volume(t, &mesh.nodes) } else { 0.0 })
                .collect();
            let image: Vec<f64> = tets.par_iter().map(|t| volume(t, x).abs()).collect();
            let sizes = averaged(tets, nodes, &own, &image);
            if own.contains(&0.0) {
                let one: Vec<f64> = own.iter().map(|own| f64::from(*own > 0.0)).collect();
                let around = averaged(tets, nodes, &one, &own);
                own.iter_mut().zip(around).for_each(|(own, around)| {
                    if *own == 0.0 {
                        *own = around;
                    }
                });
            }
            let rest = chosen.par_iter().map(|&c| {
                let (t, size) = (tets[c as usize], own[c as usize] * sizes[c as usize]);
                if shape == OwnShape::Given && quality[c as usize] > SLIVER {
                    let shape = edges(t.map(|v| mesh.nodes[v as usize]));
                    inverse(&(shape * length_or_one(sizes[c as usize].cbrt())))
                } else {
                    inverse(&(regular_edges() * length_or_one(size.cbrt())))
                }
            });
            let rest = rest.collect();
            let corners = chosen.iter().map(|&c| tets[c as usize]).collect();
            FoldoverEnergy::of_tets_with(corners, rest, nodes)
        }
        CellList::Hexes(hexes) => {
            let given = |h: &[u32; 8]| {
                let length = |[a, b]: [usize; 2]| (mesh.nodes[h[a] as usize] - mesh.nodes[h[b] as usize]).norm();
                HEX_EDGES.map(|parallel| length_or_one(0.25 * parallel.map(length).iter().sum::<f64>()))
            };
            let lengths = |h: &[u32; 8]| match shape {
                OwnShape::Given => given(h),
                OwnShape::Regular | OwnShape::Imaged => [given(h).iter().product::<f64>().cbrt(); 3],
            };
            let stretches = |h: &[u32; 8]| {
                let length = |[a, b]: [usize; 2]| (x[h[a] as usize] - x[h[b] as usize]).norm();
                let lengths = HEX_EDGES.map(|parallel| length_or_one(0.25 * parallel.map(length).iter().sum::<f64>()));
                let mean = lengths.iter().product::<f64>().cbrt();
                lengths.map(|length| (length / mean).sqrt())
            };
            let own: Vec<f64> = hexes.par_iter().map(|h| lengths(h).iter().product()).collect();
            let image = hexes.par_iter().map(|h| {
                let corner = |c: &[usize; 4]| edges(c.map(|k| x[h[k] as usize])).determinant().abs();
                0.125 * HEX_CORNERS.iter().map(corner).sum::<f64>()
            });
            let image: Vec<f64> = image.collect();
            let sizes = averaged(hexes, nodes, &own, &image);
            let boxes = chosen.iter().map(|&c| {
                let scale = length_or_one(sizes[c as usize].cbrt());
                let boxes = lengths(&hexes[c as usize]).map(|length| length * scale);
                if shape != OwnShape::Imaged {
                    return boxes;
                }
                let stretches = stretches(&hexes[c as usize]);
                std::array::from_fn(|k| boxes[k] * stretches[k])
            });
            let boxes: Vec<[f64; 3]> = boxes.collect();
            let corners = chosen.iter().map(|&c| hexes[c as usize]).collect();
            FoldoverEnergy::of_hexes_with(corners, &boxes, nodes)
        }
    }
}

fn inverse(edges: &Matrix3) -> Matrix3 {
    edges.try_inverse().unwrap_or_else(Matrix3::identity)
}

/// For each cell the ratio of `image` to `own`, averaged over some rings of cells: the ratio of sums at each node, and
/// then means of logarithms. Cells without an own volume do not count.
fn averaged<const N: usize>(cells: &[[u32; N]], nodes: usize, own: &[f64], image: &[f64]) -> Vec<f64> {
    let mut sums = vec![[0.0; 2]; nodes];
    for ((cell, &own), &image) in cells.iter().zip(own).zip(image) {
        if own > 0.0 && image.is_finite() {
            for &v in cell {
                sums[v as usize][0] += own;
                sums[v as usize][1] += image;
            }
        }
    }
    let (all, whole) = sums
        .iter()
        .fold((0.0, 0.0), |(all, whole), [own, image]| (all + own, whole + image));
    let usual = length_or_one(whole / all);
    // Where all cells around a node are flat, or there are none, the usual ratio stands in.
    let ratio = |[own, image]: &[f64; 2]| {
        let ratio = image / own;
        if ratio > LEAST_RATIO * usual && ratio.is_finite() {
            ratio.ln()
        } else {
            usual.ln()
        }
    };
    let mut logarithms: Vec<f64> = sums.iter().map(ratio).collect();
    let mut of_cells = Vec::new();
    for pass in 0..PASSES {
        let at = &logarithms;
        let mean = |cell: &[u32; N]| cell.iter().map(|&v| at[v as usize]).sum::<f64>() / N as f64;
        of_cells = cells.par_iter().map(mean).collect::<Vec<f64>>();
        if pass + 1 == PASSES {
            break;
        }
        let mut means = vec![[0.0; 2]; nodes];
        for (cell, &value) in cells.iter().zip(&of_cells) {
            for &v in cell {
                means[v as usize][0] += 1.0;
                means[v as usize][1] += value;
            }
        }
        for (logarithm, [count, sum]) in logarithms.iter_mut().zip(means) {
            if count > 0.0 {
                *logarithm = sum / count;
            }
        }
    }
    of_cells.into_iter().map(f64::exp).collect()
}

/// Ratio of volumes around a node to the usual one below which they count as collapsed.
const LEAST_RATIO: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::super::lbfgs::DescentEnergy;
    use super::*;
    use crate::mesh::CellMesh;
    use crate::remesh::bounded_mesh::faces;

    /// A row of boxes of lengths 1, 2, 4, …, and of width 1.
    fn row(count: usize) -> BoundedMesh {
        let at = |n: usize| Point::new((1 << (n / 4)) as f64, (n % 4 % 2) as f64, (n % 4 / 2) as f64);
        let hexes = (0..count as u32)
            .map(|k| [0, 4, 5, 1, 2, 6, 7, 3].map(|v| 4 * k + v))
            .collect();
        let nodes = (0..4 * (count + 1)).map(at).collect();
        let mesh = CellMesh::new(nodes, CellList::Hexes(hexes), vec![0; count]).unwrap();
        let faces = faces(mesh.cells());
        BoundedMesh::of(mesh, &faces)
    }

    #[test]
    fn a_scaled_graded_mesh_has_determinants_of_one_and_the_least_energy() {
        let mesh = row(5);
        let x: Vec<Point> = mesh.nodes.iter().map(|p| p * 7.0).collect();
        let free: Vec<u32> = (0..x.len() as u32).collect();
        for some in [None, Some(&[1, 3][..])] {
            let energy = own_size_energy(&mesh, &x, OwnShape::Given, some);
            assert!(energy.determinants(&x).iter().all(|det| (det - 1.0).abs() < 1e-12));
            let mut gradient = vec![crate::Vector::zeros(); x.len()];
            let value = energy.evaluate(&x, 1e-12, &free, &mut vec![], &mut gradient);
            assert!((value.energy - 5.0).abs() < 1e-12, "{value:?}");
            assert!(gradient.iter().all(|slope| slope.norm() < 1e-12));
        }
        // Cubes have the volumes, not the shapes.
        let cubes = own_size_energy(&mesh, &x, OwnShape::Regular, None);
        assert!(cubes.determinants(&x).iter().all(|det| (det - 1.0).abs() < 1e-12));
        assert!(cubes.evaluate(&x, 1e-12, &[], &mut vec![], &mut []).energy > 5.1);
    }

    #[test]
    fn collapsed_and_missing_images_have_finite_references() {
        let mesh = row(5);
        let collapsed = vec![Point::origin(); mesh.nodes.len()];
        let mut lost = mesh.nodes.clone();
        lost[7].x = f64::NAN;
        for x in [collapsed, lost] {
            for shape in [OwnShape::Given, OwnShape::Regular, OwnShape::Imaged] {
                let energy = own_size_energy(&mesh, &x, shape, None);
                let dets = energy.determinants(&mesh.nodes);
                assert!(dets.iter().all(|det| det.is_finite() && *det > 0.0), "{dets:?}");
            }
        }
    }
}
