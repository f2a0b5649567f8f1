//! boundary_map
