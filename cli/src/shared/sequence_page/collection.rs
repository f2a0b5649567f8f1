//! The surfaces of a sequence: files with their times, of which all have the same triangles.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use solidmap::Point;
use solidmap::io::{self, Field, SurfaceFields};

/// The collection that `solidmap sequence` writes of the frames' surfaces.
pub const SURFACES: &str = "surface.pvd";
/// The field of each vertex's place in the reference.
const REFERENCE: &str = "reference";

/// A collection, and the files that it lists, in the order of time.
pub struct Collection {
    /// The collection.
    pub path: PathBuf,
    /// Times and files; at least one.
    pub steps: Vec<(f64, PathBuf)>,
}

/// Whether a path may be a sequence.
pub fn is_sequence(path: &Path) -> bool {
    path.is_dir() || super::input::extension(path) == "pvd"
}

impl Collection {
    /// Reads a collection, or that of the surfaces in a folder of `solidmap sequence`.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let path = if path.is_dir() {
            let inner = path.join(SURFACES);
            ensure!(
                inner.is_file(),
                "the folder `{}` has no `{SURFACES}`: give a folder that `solidmap sequence` has written without --no-vtu, \
                 or a .pvd file of surfaces",
                path.display()
            );
            inner
        } else {
            path.to_owned()
        };
        let shown = path.display();
        let mut steps = io::read_pvd(&path)?;
        ensure!(
            !steps.is_empty(),
            "`{shown}` lists no files: there is nothing to look at"
        );
        let odd = steps.iter().find(|(time, _)| !time.is_finite());
        if let Some((time, file)) = odd {
            anyhow::bail!(
                "`{shown}` gives `{}` the time {time}: give it a finite one",
                file.display()
            );
        }
        steps.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let twice = steps.windows(2).find(|pair| pair[0].0 == pair[1].0);
        if let Some([(time, a), (_, b)]) = twice {
            anyhow::bail!(
                "`{shown}` lists `{}` and `{}` for the time {time}: a page shows one surface for each time; merge them",
                a.display(),
                b.display()
            );
        }
        Ok(Self { path, steps })
    }

    /// The surface of a frame, which must have the triangles of the first one.
    pub fn frame(&self, frame: usize, first: Option<&SurfaceFields>) -> anyhow::Result<SurfaceFields> {
        let path = &self.steps[frame].1;
        let read = io::read_surface_with_fields(path).with_context(|| {
            let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
            format!("cannot show `{stem}.pvd`, which needs files of surfaces, such as `{SURFACES}` of `solidmap sequence` lists")
        })?;
        ensure!(
            read.surface
                .vertices()
                .iter()
                .flat_map(Point::iter)
                .all(|x| x.is_finite()),
            "`{}` has vertices that are not finite: leave it out of `{}`",
            path.display(),
            self.path.display()
        );
        if let Some(first) = first {
            let same = read.surface.vertices().len() == first.surface.vertices().len()
                && read.surface.triangles() == first.surface.triangles();
            ensure!(
                same,
                "`{}` has other triangles than `{}`: a page shows frames of one connectivity",
                path.display(),
                self.steps[0].1.display()
            );
        }
        Ok(read)
    }
}

/// Where the vertices are in the reference, and whether the file says so: otherwise the reference is this frame.
pub fn reference(frame: &SurfaceFields) -> (Vec<Point>, bool) {
    let is_reference = |field: &&Field| {
        let is_finite = field.values.iter().all(|x| x.is_finite());
        field.name == REFERENCE && field.components == 3 && is_finite
    };
    match frame.point.iter().find(is_reference) {
        Some(field) => (field.values.chunks_exact(3).map(Point::from_slice).collect(), true),
        None => (frame.surface.vertices().to_vec(), false),
    }
}

/// The scalars of a frame by their names, those over triangles first.
pub fn scalars(frame: SurfaceFields) -> Vec<Field> {
    let all = frame.triangle.into_iter().chain(frame.point);
    all.filter(|field| field.components == 1).collect()
}
