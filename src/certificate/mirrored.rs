//! Parts of a domain whose orientation a map reverses as a whole.

use super::MirroredParts;
use crate::Point;
use crate::map::VolumeMap;
use crate::mesh::SurfaceMesh;
use crate::mesh::topology::{NONE, Topology};

impl MirroredParts {
    /// From the signed volumes that the images of the domain's shells enclose. The shells of cavities do not count.
    pub(super) fn find(map: &dyn VolumeMap, domain: &SurfaceMesh, orientation: f64) -> Self {
        let components = Topology::new(domain).components();
        let volumes = shell_volumes(
            domain,
            domain.vertices(),
            &components.of_triangle,
            components.shapes.len(),
        );
        let outer = || (0..volumes.len()).filter(|&shell| volumes[shell] > 0.0);
        let parts = outer().count();
        if parts < 2 {
            return Self {
                count: 0,
                parts,
                fraction: 0.0,
            };
        }
        let images = map.evaluate(domain.vertices());
        let images = shell_volumes(domain, &images, &components.of_triangle, components.shapes.len());
        let mirrored = || outer().filter(|&shell| images[shell] * orientation < 0.0);
        let total: f64 = outer().map(|shell| volumes[shell]).sum();
        Self {
            count: mirrored().count(),
            parts,
            fraction: mirrored().map(|shell| volumes[shell]).sum::<f64>() / total,
        }
    }
}

/// The signed volume of each shell with its vertices at these positions, by tetrahedra from the first corner of the
/// shell.
fn shell_volumes(mesh: &SurfaceMesh, positions: &[Point], shell_of: &[u32], shells: usize) -> Vec<f64> {
    let mut volumes = vec![0.0; shells];
    let mut apexes = vec![None; shells];
    for (triangle, &shell) in mesh.triangles().iter().zip(shell_of) {
        if shell == NONE {
            continue;
        }
        let [a, b, c] = triangle.map(|v| positions[v as usize]);
        let apex: Point = *apexes[shell as usize].get_or_insert(a);
        volumes[shell as usize] += (a - apex).dot(&(b - apex).cross(&(c - apex))) / 6.0;
    }
    volumes
}
