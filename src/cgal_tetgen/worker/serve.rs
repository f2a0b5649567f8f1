//! The worker's side: one call after another, until nobody asks any more.

use std::collections::HashMap;
use std::io::{BufReader, BufWriter};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::channel;

use super::{Frame, Operation};
use crate::cgal_tetgen::calls;
use crate::cgal_tetgen::distance::LocalField;
use crate::cgal_tetgen::error::Failed;
use crate::cgal_tetgen::input::{flat, points};
use crate::mesh::SurfaceMesh;

/// Does what the process that started this one asks for over standard input, a socket, and ends with it. For programs
/// that [`isolate`](super::isolate) starts; it must not be called in any other.
///
/// # Errors
///
/// When standard input is no socket.
pub fn serve_calls() -> std::io::Result<()> {
    let socket = UnixStream::from(std::io::stdin().as_fd().try_clone_to_owned()?);
    // Fails where standard input is anything else.
    socket.peer_addr()?;
    let mut reader = BufReader::new(socket.try_clone()?);
    let (send, requests) = channel();
    // Waits for the next request while one is worked on, so that the end of the other process ends this one at once.
    std::thread::spawn(move || {
        while let Ok(request) = Frame::read(&mut reader) {
            if send.send(request).is_err() {
                break;
            }
        }
        std::process::exit(0);
    });
    let mut desk = Desk::default();
    for request in requests {
        let answer = desk.answer(request).unwrap_or_else(|failed| Frame {
            tag: failed.code as u32,
            text: failed.message,
            ..Frame::default()
        });
        answer.write(&mut BufWriter::new(&socket))?;
    }
    Ok(())
}

/// What is kept from one call to the next.
#[derive(Default)]
struct Desk {
    fields: HashMap<u32, LocalField>,
    made: u32,
}

impl Desk {
    /// Options stand before the coordinates; how many there are, the operation says.
    fn answer(&mut self, request: Frame) -> Result<Frame, Failed> {
        let operation = Operation::of_tag(request.tag).ok_or_else(|| Failed::unknown("an unknown request"))?;
        let (reals, integers) = (&request.reals[..], &request.integers[..]);
        Ok(match operation {
            Operation::SelfTest
            | Operation::Tetgen
            | Operation::Mesh3
            | Operation::Wrap
            | Operation::Remesh
            | Operation::Intersections => {
                let split = reals.split_at_checked(operation.options());
                let (options, xyz) = split.ok_or_else(|| Failed::unknown("options are missing"))?;
                let made = calls::here(operation, xyz, integers, options)?;
                Frame {
                    reals: made.xyz,
                    integers: made.corners,
                    ..Frame::default()
                }
            }
            Operation::NewField => {
                let triangles = integers.as_chunks::<3>().0.to_vec();
                let surface =
                    SurfaceMesh::new(points(reals), triangles).map_err(|error| Failed::unknown(&error.to_string()))?;
                self.made += 1;
                self.fields.insert(self.made, LocalField::new(&surface)?);
                Frame {
                    integers: vec![self.made],
                    ..Frame::default()
                }
            }
            Operation::Distance => numbers(self.field(integers)?.distance(&points(reals))),
            Operation::Closest => numbers(flat(&self.field(integers)?.closest_points(&points(reals)))),
            Operation::Volume => numbers(vec![self.field(integers)?.volume()?]),
            Operation::DropField => {
                integers.first().map(|number| self.fields.remove(number));
                Frame::default()
            }
        })
    }

    fn field(&self, integers: &[u32]) -> Result<&LocalField, Failed> {
        let field = integers.first().and_then(|number| self.fields.get(number));
        field.ok_or_else(|| Failed::unknown("a distance field that is not there"))
    }
}

fn numbers(reals: Vec<f64>) -> Frame {
    Frame {
        reals,
        ..Frame::default()
    }
}
