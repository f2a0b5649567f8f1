//! The worker's side: serves one request after another until the connection closes.

use std::collections::HashMap;
use std::io::{BufReader, BufWriter};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::channel;

use super::{Message, Operation};
use crate::cgal_tetgen::calls;
use crate::cgal_tetgen::distance::LocalField;
use crate::cgal_tetgen::error::CallFailure;
use crate::cgal_tetgen::input::{flat, points};
use crate::mesh::SurfaceMesh;

/// Serves requests of the parent process over standard input, which must be a socket, and exits when the parent does.
/// Only for programs that [`isolate`](super::isolate) starts.
///
/// # Errors
///
/// When standard input is not a socket.
pub fn serve_calls() -> std::io::Result<()> {
    let socket = UnixStream::from(std::io::stdin().as_fd().try_clone_to_owned()?);
    // Fails unless standard input is a socket.
    socket.peer_addr()?;
    let mut reader = BufReader::new(socket.try_clone()?);
    let (send, requests) = channel();
    // Reads ahead, so that this process exits as soon as the parent does, even in the middle of an operation.
    std::thread::spawn(move || {
        while let Ok(request) = Message::read(&mut reader) {
            if send.send(request).is_err() {
                break;
            }
        }
        std::process::exit(0);
    });
    let mut server = Server::default();
    for request in requests {
        let reply = server.reply(request).unwrap_or_else(|failure| Message {
            tag: failure.code as u32,
            text: failure.message,
            ..Message::default()
        });
        reply.write(&mut BufWriter::new(&socket))?;
    }
    Ok(())
}

/// The distance fields, which outlive a request.
#[derive(Default)]
struct Server {
    fields: HashMap<u32, LocalField>,
    last_id: u32,
}

impl Server {
    fn reply(&mut self, request: Message) -> Result<Message, CallFailure> {
        let operation = Operation::from_tag(request.tag).ok_or_else(|| CallFailure::unknown("an unknown request"))?;
        let (reals, integers) = (&request.reals[..], &request.integers[..]);
        Ok(match operation {
            Operation::NewField => {
                let triangles = integers.as_chunks::<3>().0.to_vec();
                let surface = SurfaceMesh::new(points(reals), triangles)
                    .map_err(|error| CallFailure::unknown(&error.to_string()))?;
                self.last_id += 1;
                self.fields.insert(self.last_id, LocalField::new(&surface)?);
                Message {
                    integers: vec![self.last_id],
                    ..Message::default()
                }
            }
            Operation::Distance => reals_message(self.field(integers)?.distance(&points(reals))),
            Operation::Closest => reals_message(flat(&self.field(integers)?.closest_points(&points(reals)))),
            Operation::Volume => reals_message(vec![self.field(integers)?.volume()?]),
            Operation::DropField => {
                integers.first().map(|id| self.fields.remove(id));
                Message::default()
            }
            _ => {
                let split = reals.split_at_checked(operation.option_count());
                let (options, xyz) = split.ok_or_else(|| CallFailure::unknown("options are missing"))?;
                let mesh = calls::run_in_process(operation, xyz, integers, options)?;
                Message {
                    reals: mesh.xyz,
                    integers: mesh.corners,
                    ..Message::default()
                }
            }
        })
    }

    fn field(&self, integers: &[u32]) -> Result<&LocalField, CallFailure> {
        let field = integers.first().and_then(|id| self.fields.get(id));
        field.ok_or_else(|| CallFailure::unknown("no such distance field"))
    }
}

fn reals_message(reals: Vec<f64>) -> Message {
    Message {
        reals,
        ..Message::default()
    }
}
