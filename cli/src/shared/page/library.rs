//! What every page has besides its data: three.js, and the page's own modules, styles and template.

/// A module of JavaScript, and the name that others import it by.
pub struct Module {
    /// The name.
    pub name: &'static str,
    /// Its text.
    pub text: &'static str,
}

/// The version of three.js.
pub const THREE_VERSION: &str = "0.184.0";

/// The licence of three.js, which must accompany it.
pub const THREE_LICENCE: &str = include_str!("three/LICENSE");

/// The name by which the build of three.js imports its other half. A page's modules have no address that it could be
/// relative to, so that it is replaced by a name.
pub const CORE_IMPORT: [&str; 2] = ["\"./three.core.min.js\"", "\"three/core\""];

/// The template: `{{NAME}}` stands for what [`super::Page`] writes.
pub const TEMPLATE: &str = include_str!("assets/page.html");

/// The styles.
pub const STYLE: &str = include_str!("assets/page.css");

/// The script that unpacks the modules; the only one that the browser runs by itself.
pub const START: &str = include_str!("assets/start.js");

/// The modules; the last one is started.
pub const MODULES: [Module; 22] = [
    Module {
        name: "three/core",
        text: include_str!("three/three.core.min.js"),
    },
    Module {
        name: "three",
        text: include_str!("three/three.module.min.js"),
    },
    Module {
        name: "three/orbit",
        text: include_str!("three/OrbitControls.js"),
    },
    Module {
        name: "page/data",
        text: include_str!("assets/data.js"),
    },
    Module {
        name: "page/elements",
        text: include_str!("assets/elements.js"),
    },
    Module {
        name: "page/stage",
        text: include_str!("assets/stage.js"),
    },
    Module {
        name: "page/colours",
        text: include_str!("assets/colours.js"),
    },
    Module {
        name: "page/pick",
        text: include_str!("assets/pick.js"),
    },
    Module {
        name: "page/harmonic",
        text: include_str!("assets/harmonic.js"),
    },
    Module {
        name: "page/buffers",
        text: include_str!("assets/buffers.js"),
    },
    Module {
        name: "page/cut-controls",
        text: include_str!("assets/cut-controls.js"),
    },
    Module {
        name: "page/cut",
        text: include_str!("assets/cut.js"),
    },
    Module {
        name: "page/map-shaders",
        text: include_str!("assets/map-shaders.js"),
    },
    Module {
        name: "page/map",
        text: include_str!("assets/map.js"),
    },
    Module {
        name: "page/histogram",
        text: include_str!("assets/histogram.js"),
    },
    Module {
        name: "page/mesh",
        text: include_str!("assets/mesh.js"),
    },
    Module {
        name: "page/boundary",
        text: include_str!("assets/boundary.js"),
    },
    Module {
        name: "page/curve",
        text: include_str!("assets/curve.js"),
    },
    Module {
        name: "page/sequence",
        text: include_str!("assets/sequence.js"),
    },
    Module {
        name: "page/report",
        text: include_str!("assets/report.js"),
    },
    Module {
        name: "page/texture",
        text: include_str!("assets/texture.js"),
    },
    Module {
        name: "page/main",
        text: include_str!("assets/main.js"),
    },
];
