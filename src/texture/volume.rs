//! The texture as a volume of voxels.

use super::colour::{LinearRgb, to_srgb};
use super::{SolidTexture, TextureError};
use crate::Point;
use crate::memory;
use crate::mesh::SurfaceMesh;

/// Cubic voxels over the bounding box of a solid. The texture is sampled at their centres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelGrid {
    /// Centre of the first voxel, the one of lowest coordinates.
    pub origin: Point,
    /// Side of a voxel.
    pub spacing: f64,
    /// Voxels along x, y and z.
    pub size: [usize; 3],
}

/// The colours of all voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct VoxelTexture {
    /// Where the voxels are.
    pub grid: VoxelGrid,
    /// Red, green and blue in 8-bit sRGB, and 255 in the solid or 0, with black, outside. Voxels along x follow each
    /// other, then rows along y, then layers along z.
    pub rgba: Vec<[u8; 4]>,
    /// Voxels in the solid.
    pub inside: usize,
}

/// Peak memory per voxel: its colour, and its part of a compressed copy.
const BYTES_PER_VOXEL: f64 = 8.0;
/// Points evaluated at a time, and the memory that each takes.
const POINTS_AT_ONCE: usize = 1 << 19;
const BYTES_PER_POINT: f64 = 600.0;
pub(super) const GIB: f64 = 1024.0 * 1024.0 * 1024.0;

/// Bytes that may be used; no limit where the available memory is unknown.
pub(super) fn allowed_memory() -> f64 {
    memory::default_budget().map_or(isize::MAX as f64, |bytes| bytes as f64)
}

impl VoxelGrid {
    /// `resolution` voxels along the longest side of the solid's box, and as many as needed along the others.
    ///
    /// # Errors
    ///
    /// [`TextureError::NoVoxels`], and [`TextureError::TooLarge`] when they need more memory than is available.
    pub fn of(surface: &SurfaceMesh, resolution: usize) -> Result<Self, TextureError> {
        let (low, high) = surface.bounding_box().unwrap_or_default();
        let sides = high - low;
        let longest = sides.max();
        if resolution == 0 || !(longest > 0.0 && longest.is_finite()) {
            return Err(TextureError::NoVoxels);
        }
        let spacing = longest / resolution as f64;
        // Rounding must not add a voxel to a side that is a whole number of voxels.
        let size = [0, 1, 2].map(|k| ((sides[k] / spacing - 1e-9).ceil() as usize).clamp(1, resolution));
        let grid = Self {
            origin: low
                + sides.zip_map(&size.map(|n| n as f64).into(), |side, n: f64| {
                    0.5 * (side - (n - 1.0) * spacing)
                }),
            spacing,
            size,
        };
        grid.require_room()?;
        Ok(grid)
    }

    /// How many voxels there are.
    pub fn voxels(&self) -> usize {
        self.size.iter().product()
    }

    /// The centre of a voxel.
    pub fn centre(&self, voxel: usize) -> Point {
        let [width, height, _] = self.size;
        let steps = [voxel % width, voxel / width % height, voxel / width / height];
        Point::from([0, 1, 2].map(|k| self.origin[k] + steps[k] as f64 * self.spacing))
    }

    fn require_room(&self) -> Result<(), TextureError> {
        let voxels: f64 = self.size.iter().map(|&n| n as f64).product();
        let need = voxels * BYTES_PER_VOXEL + voxels.min(POINTS_AT_ONCE as f64) * BYTES_PER_POINT;
        let allowed = allowed_memory();
        if need <= allowed {
            return Ok(());
        }
        Err(TextureError::TooLarge {
            size: self.size,
            need: need / GIB,
            allowed: allowed / GIB,
        })
    }
}

impl VoxelTexture {
    /// The colours that `sample` gives the centres of all voxels, NaN where there is none. `progress` is called with the
    /// number of voxels done so far.
    pub fn sampled(
        grid: &VoxelGrid,
        mut sample: impl FnMut(&[Point]) -> Vec<LinearRgb>,
        progress: &dyn Fn(usize),
    ) -> Self {
        let voxels = grid.voxels();
        let mut rgba = Vec::with_capacity(voxels);
        for first in (0..voxels).step_by(POINTS_AT_ONCE) {
            let centres: Vec<Point> = (first..voxels.min(first + POINTS_AT_ONCE))
                .map(|k| grid.centre(k))
                .collect();
            rgba.extend(sample(&centres).into_iter().map(|light| {
                if light[0].is_nan() {
                    return [0; 4];
                }
                let [r, g, b] = to_srgb(light);
                [r, g, b, 255]
            }));
            progress(rgba.len());
        }
        Self {
            grid: *grid,
            inside: rgba.iter().filter(|voxel| voxel[3] > 0).count(),
            rgba,
        }
    }
}

impl SolidTexture {
    /// The texture at the centres of all voxels. `progress` is called with the number of voxels done so far.
    pub fn volume(&self, grid: &VoxelGrid, progress: &dyn Fn(usize)) -> VoxelTexture {
        VoxelTexture::sampled(grid, |centres| self.sample(centres), progress)
    }
}
