//! Real models for tests: the folder is named by `SOLIDMAP_MODELS`.

use crate::Point;
use crate::mesh::SurfaceMesh;

/// An OBJ model, polygons fanned into triangles; `None`, loudly, when no folder is named.
pub(crate) fn load(name: &str) -> Option<SurfaceMesh> {
    let Ok(folder) = std::env::var("SOLIDMAP_MODELS") else {
        eprintln!("SKIPPED: {name} is not tested; set SOLIDMAP_MODELS to the folder of models");
        return None;
    };
    let path = std::path::Path::new(&folder).join(name);
    let text = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    Some(parse(
        &String::from_utf8_lossy(&text)
            .replace("\\\n", " ")
            .replace("\\\r\n", " "),
    ))
}

fn parse(text: &str) -> SurfaceMesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let x: Vec<f64> = words.take(3).map(|w| w.parse().unwrap()).collect();
                vertices.push(Point::new(x[0], x[1], x[2]));
            }
            Some("f") => {
                let count = vertices.len() as i64;
                let index = |w: &str| w.split('/').next().and_then(|i| i.parse::<i64>().ok());
                let zero_based = |i: i64| if i < 0 { count + i } else { i - 1 } as u32;
                let corners: Vec<u32> = words.filter_map(index).map(zero_based).collect();
                triangles.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
            }
            _ => {}
        }
    }
    SurfaceMesh::new(vertices, triangles).unwrap()
}
