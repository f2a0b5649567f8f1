//! XML files in all encodings, for the tests of the readers.

use std::io::Write;

use base64::{Engine, engine::general_purpose::STANDARD};
use flate2::{Compression, write::ZlibEncoder};

use crate::io::input::ByteOrder;

/// How a test file stores its arrays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Storage {
    Text,
    Inline,
    AppendedRaw,
    AppendedBase64,
}

/// Writes the arrays of a file in any of the ways that VTK has.
pub(super) struct Builder {
    storage: Storage,
    order: ByteOrder,
    wide_header: bool,
    /// Bytes in a compressed block.
    block: Option<usize>,
    appended: Vec<u8>,
}

impl Builder {
    fn in_order(&self, mut bytes: Vec<u8>) -> Vec<u8> {
        if self.order == ByteOrder::Big {
            bytes.reverse();
        }
        bytes
    }

    fn lengths(&self, lengths: &[usize]) -> Vec<u8> {
        let bytes = |&n: &usize| match self.wide_header {
            true => self.in_order((n as u64).to_le_bytes().to_vec()),
            false => self.in_order((n as u32).to_le_bytes().to_vec()),
        };
        lengths.iter().flat_map(bytes).collect()
    }

    /// An array with these attributes.
    pub fn array(&mut self, attributes: &str, values: &[f64]) -> String {
        let bytes: Vec<u8> = values
            .iter()
            .flat_map(|&x| {
                self.in_order(match attributes {
                    a if a.contains("Float64") => x.to_le_bytes().to_vec(),
                    a if a.contains("Float32") => (x as f32).to_le_bytes().to_vec(),
                    a if a.contains("Int64") => (x as i64).to_le_bytes().to_vec(),
                    a if a.contains("Int32") => (x as i32).to_le_bytes().to_vec(),
                    _ => vec![x as u8],
                })
            })
            .collect();
        let (head, data) = match self.block {
            None => (self.lengths(&[bytes.len()]), bytes),
            Some(size) => {
                let zip = |block: &[u8]| {
                    let mut encoder = ZlibEncoder::new(vec![], Compression::default());
                    encoder.write_all(block).unwrap();
                    encoder.finish().unwrap()
                };
                let blocks: Vec<_> = bytes.chunks(size).map(zip).collect();
                let mut lengths = vec![blocks.len(), size, bytes.len() % size];
                lengths.extend(blocks.iter().map(Vec::len));
                (self.lengths(&lengths), blocks.concat())
            }
        };
        let base64 = || STANDARD.encode(&head) + &STANDARD.encode(&data);
        let (format, offset) = match self.storage {
            Storage::Text => ("ascii", None),
            Storage::Inline => ("binary", None),
            _ => ("appended", Some(self.appended.len())),
        };
        let text = match self.storage {
            Storage::Text => values.iter().map(|x| format!("{x} ")).collect(),
            Storage::Inline => format!("\n  {}\n", base64()),
            _ => String::new(),
        };
        match self.storage {
            Storage::AppendedRaw => self.appended.extend([head, data].concat()),
            Storage::AppendedBase64 => self.appended.extend(base64().as_bytes()),
            _ => {}
        }
        let offset = offset.map_or(String::new(), |offset| format!(" offset=\"{offset}\""));
        match text.as_str() {
            "" => format!("<DataArray {attributes} format=\"{format}\"{offset}/>\n"),
            // VTK adds the norms of an array after its numbers.
            text => format!("<DataArray {attributes} format=\"{format}\">{text}<InformationKey/></DataArray>\n"),
        }
    }

    /// A file of this data set.
    pub fn file(self, data_set: &str, body: &str) -> Vec<u8> {
        let order = match self.order {
            ByteOrder::Big => "BigEndian",
            ByteOrder::Little => "LittleEndian",
        };
        let header = if self.wide_header {
            " header_type=\"UInt64\""
        } else {
            ""
        };
        let zlib = match self.block {
            Some(_) => " compressor=\"vtkZLibDataCompressor\"",
            None => "",
        };
        let head = format!(
            "<?xml version=\"1.0\"?>\n<!-- <Points> -->\n<VTKFile type=\"{data_set}\" version=\"1.0\" \
             byte_order=\"{order}\"{header}{zlib}>\n"
        );
        let mut bytes = (head + body).into_bytes();
        let encoding = match self.storage {
            Storage::AppendedRaw => Some("raw"),
            Storage::AppendedBase64 => Some("base64"),
            _ => None,
        };
        if let Some(encoding) = encoding {
            bytes.extend(format!("<AppendedData encoding=\"{encoding}\">\n   _").bytes());
            bytes.extend(self.appended);
            bytes.extend(b"\n</AppendedData>\n");
        }
        bytes.extend(b"</VTKFile>\n");
        bytes
    }

    /// Every way of storing numbers, by name.
    pub fn all() -> impl Iterator<Item = (String, Self)> {
        let storages = [
            Storage::Text,
            Storage::Inline,
            Storage::AppendedRaw,
            Storage::AppendedBase64,
        ];
        let orders = [ByteOrder::Little, ByteOrder::Big];
        let blocks = [None, Some(1 << 15), Some(10)];
        let ways = storages.into_iter().flat_map(move |s| orders.map(|order| (s, order)));
        let ways = ways.flat_map(|(s, order)| [false, true].map(|wide| (s, order, wide)));
        let ways = ways.flat_map(move |(s, order, wide)| blocks.map(|block| (s, order, wide, block)));
        ways.map(|(storage, order, wide_header, block)| {
            let builder = Self {
                storage,
                order,
                wide_header,
                block,
                appended: vec![],
            };
            (format!("{storage:?} {order:?} {wide_header} {block:?}"), builder)
        })
    }
}
