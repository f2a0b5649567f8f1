#![doc = "Dependencies alone: see Cargo.toml."]
