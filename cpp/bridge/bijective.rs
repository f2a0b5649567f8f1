//! Bijective maps.

use std::sync::Arc;

use super::bridge::ffi;
use super::bridge::ffi::Watcher;
use super::error::{Error, ErrorKind, guarded};
use super::maps::{Map, preimages_of, require_room, write, write_rows};
use super::meshes::{VolumeMesh, tets_of, whole_points};
use super::solids::on_remesh_phase;
use super::{flat, path};
use solidmap::bijective::{self, BijectiveMap, BoundaryProof, RefinementOptions, make_bijective, refined_at_boundary};
use solidmap::files;
use solidmap::fit::self_intersection_finder;
use solidmap::map::VolumeMap;
use solidmap::mesh::CellMesh;
use solidmap::remesh::RemeshOptions;

pub struct Bijective(Arc<bijective::Bijective>);

// The C++ class promises that its `const` functions may run on any number of threads at once.
const _: () = {
    const fn shared<T: Send + Sync>() {}
    shared::<Bijective>();
};

pub fn bijective_new(
    map: &Map,
    mesh: &VolumeMesh,
    tolerance: f64,
    most_added: usize,
    effort: f64,
    memory: u64,
    watcher: &Watcher,
) -> Result<Box<Bijective>, Error> {
    guarded(|| {
        let tets = tets_of(mesh, "a bijective map is linear over")?;
        let boundary = map.boundary_map()?;
        let refinement = RefinementOptions {
            tolerance,
            ..RefinementOptions::default()
        };
        let (mesh, _) = refined_at_boundary(boundary, tets, &refinement, self_intersection_finder())?;
        let options = RemeshOptions {
            effort,
            most_added: (most_added != usize::MAX).then_some(most_added),
            memory: (memory > 0).then_some(memory),
            ..RemeshOptions::default()
        };
        let progress = |phase| on_remesh_phase(watcher, phase);
        let made = make_bijective(
            boundary,
            map.map(),
            mesh,
            &options,
            self_intersection_finder(),
            &progress,
        )?;
        Ok(Box::new(Bijective(Arc::new(made))))
    })
}

pub fn bijective_of(map: &Map) -> Result<Box<Bijective>, Error> {
    guarded(|| match &map.file().bijective {
        Some(bijective) => Ok(Box::new(Bijective(Arc::new(bijective.clone())))),
        None => Err(Error::new(
            ErrorKind::Unsupported,
            "the map's file holds no bijective map",
        )),
    })
}

impl Bijective {
    fn map(&self) -> &BijectiveMap {
        &self.0.map
    }

    pub fn save(&self, map: &Map, bytes: &[u8]) -> Result<(), Error> {
        guarded(|| {
            let file = map.file().clone().with_bijective((*self.0).clone());
            Ok(files::write_map(&path(bytes)?, &file)?)
        })
    }

    pub fn evaluate(&self, points: &[f64], images: &mut [f64]) -> Result<(), Error> {
        guarded(|| {
            require_room(images, points.len(), 3)?;
            write(images, flat(&self.map().evaluate(whole_points("points", points)?)))
        })
    }

    pub fn jacobian(&self, points: &[f64], jacobians: &mut [f64]) -> Result<(), Error> {
        guarded(|| {
            require_room(jacobians, 3 * points.len(), 9)?;
            write_rows(jacobians, &self.map().jacobian(whole_points("points", points)?))
        })
    }

    pub fn preimages(&self, points: &[f64]) -> Result<Vec<ffi::Preimage>, Error> {
        guarded(|| Ok(preimages_of(self.map().preimages(whole_points("points", points)?).0)))
    }

    pub fn report(&self) -> Result<ffi::BijectiveReport, Error> {
        guarded(|| {
            let found = &self.0.report;
            Ok(ffi::BijectiveReport {
                tets: found.tets,
                nodes: found.nodes,
                boundary_nodes: found.boundary_nodes,
                inverted_as_mapped: found.inverted_as_mapped,
                cells_added: found.cells_added,
                min_scaled_jacobian: found.min_scaled_jacobian,
                difference_rms: found.difference_rms,
                difference_max: found.difference_max,
                difference_place: found.difference_place,
                gap: found.gap,
                boundary_one_to_one: found.boundary == BoundaryProof::OneToOne,
            })
        })
    }

    pub fn domain(&self) -> Result<Box<VolumeMesh>, Error> {
        guarded(|| Ok(Box::new(VolumeMesh(CellMesh::from(self.map().domain().clone())))))
    }

    pub fn target(&self) -> Result<Box<VolumeMesh>, Error> {
        guarded(|| Ok(Box::new(VolumeMesh(CellMesh::from(self.map().target().clone())))))
    }
}
