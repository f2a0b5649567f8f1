//! Series of files for ParaView: energies in the reference's cells and on the frames' surfaces, and a mesh with fields
//! that is carried along.

use std::path::{Path, PathBuf};

use anyhow::Context;
use solidmap::Point;
use solidmap::files;
use solidmap::io::{self, Cells, Field, VtkFields};
use solidmap::map::VolumeMap;
use solidmap::mesh::{CellMesh, SurfaceMesh};
use solidmap::sequence::{FrameMeasurement, Sequence};

use super::folder::{CELLS, MATERIAL, SURFACE, collection_name, frame_name};
use crate::shared::fields::MeshWithFields;

/// The series of energies.
pub struct Series {
    folder: PathBuf,
    /// Centroids of the reference's triangles.
    centroids: Vec<Point>,
    /// Times and names of the frames.
    steps: Vec<(f64, String)>,
    bytes: [u64; 2],
}

impl Series {
    pub fn new(folder: &Path, domain: &SurfaceMesh) -> anyhow::Result<Self> {
        for series in [CELLS, SURFACE] {
            let path = folder.join(series);
            std::fs::create_dir_all(&path).with_context(|| format!("cannot make the folder `{}`", path.display()))?;
        }
        let centroid = |t: usize| {
            let [a, b, c] = domain.corners(t);
            a + ((b - a) + (c - a)) / 3.0
        };
        Ok(Self {
            folder: folder.to_owned(),
            centroids: (0..domain.triangles().len()).map(centroid).collect(),
            steps: Vec::new(),
            bytes: [0; 2],
        })
    }

    /// Where surface densities are needed: the centroid of each triangle.
    pub fn centroids(&self) -> &[Point] {
        &self.centroids
    }

    /// Writes both files of a frame; `surface` has the densities at [`Self::centroids`].
    pub fn add(
        &mut self,
        (frame, time): (usize, f64),
        measured: &FrameMeasurement,
        image: &[Point],
        surface: Vec<f64>,
        sequence: &Sequence,
    ) -> anyhow::Result<()> {
        let name = frame_name(frame);
        let paths = [CELLS, SURFACE].map(|series| self.folder.join(series).join(&name));
        let densities = &measured.densities;
        let fields: [(&str, &[f64]); 3] = [
            ("deformation_energy", &densities.deformation),
            ("harmonic_energy", &densities.harmonic),
            ("det_jacobian", &densities.det_jacobian),
        ];
        let tets = measured
            .map
            .bijective()
            .map(|made| CellMesh::from(made.map.domain().clone()));
        files::write_cell_means(&paths[0], &measured.quadrature, tets.as_ref(), &fields)?;
        let domain = sequence.domain();
        let fields = VtkFields {
            point: vec![Field::positions("reference", domain.vertices())],
            cell: vec![Field::scalar("deformation_energy", surface)],
            ..VtkFields::default()
        };
        io::write_vtu(&paths[1], image, Cells::Triangles(domain.triangles()), &fields)?;
        for (bytes, path) in self.bytes.iter_mut().zip(&paths) {
            *bytes += std::fs::metadata(path).map_or(0, |file| file.len());
        }
        self.steps.push((time, name));
        Ok(())
    }

    /// Writes the collections.
    pub fn finish(&self) -> anyhow::Result<()> {
        [CELLS, SURFACE]
            .iter()
            .try_for_each(|series| write_collection(&self.folder, series, &self.steps))
    }

    /// The files and their sizes.
    pub fn describe(&self) -> String {
        let count = self.steps.len().max(1) as f64;
        let [cells, surface] = self.bytes.map(|bytes| bytes as f64 / count / 1_048_576.0);
        format!("cells.pvd ({cells:.2} MiB a frame) and surface.pvd ({surface:.2} MiB a frame), for ParaView")
    }
}

/// A mesh with fields, carried by the map of every frame.
pub struct Material {
    folder: PathBuf,
    mesh: MeshWithFields,
    steps: Vec<(f64, String)>,
}

impl Material {
    pub fn new(folder: &Path, mesh: MeshWithFields) -> anyhow::Result<Self> {
        let path = folder.join(MATERIAL);
        std::fs::create_dir_all(&path).with_context(|| format!("cannot make the folder `{}`", path.display()))?;
        Ok(Self {
            folder: folder.to_owned(),
            mesh,
            steps: Vec::new(),
        })
    }

    /// Writes the mesh as the map of a frame carries it; vectors are turned and stretched with the solid.
    pub fn add(&mut self, (frame, time): (usize, f64), map: &dyn VolumeMap) -> anyhow::Result<()> {
        let name = frame_name(frame);
        let reference = Field::positions("reference", &self.mesh.carrier.points);
        self.mesh
            .carried(map)?
            .write_mesh(&self.folder.join(MATERIAL).join(&name), vec![reference])?;
        self.steps.push((time, name));
        Ok(())
    }

    /// Writes the collection.
    pub fn finish(&self) -> anyhow::Result<()> {
        write_collection(&self.folder, MATERIAL, &self.steps)
    }
}

fn write_collection(folder: &Path, series: &str, steps: &[(f64, String)]) -> anyhow::Result<()> {
    let steps: Vec<(f64, String)> = steps
        .iter()
        .map(|(time, name)| (*time, format!("{series}/{name}")))
        .collect();
    Ok(io::write_pvd(folder.join(collection_name(series)), &steps)?)
}
