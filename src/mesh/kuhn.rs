//! Kuhn's subdivision of a cube.

/// One tetrahedron for each of the six paths along edges from a corner of a cube to the opposite one, all right-handed.
/// Bit `k` of a corner is set on the upper side of axis `k`.
pub(crate) const KUHN: [[usize; 4]; 6] = [
    [0b000, 0b001, 0b011, 0b111],
    [0b000, 0b010, 0b110, 0b111],
    [0b000, 0b100, 0b101, 0b111],
    [0b000, 0b011, 0b010, 0b111],
    [0b000, 0b110, 0b100, 0b111],
    [0b000, 0b101, 0b001, 0b111],
];
