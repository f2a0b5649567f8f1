#pragma once

/// The largest error of a fitted map at points inside a ball that is rotated and stretched.
double largest_error();

/// Whether an open surface is refused as it should be.
bool refuses_open_surfaces();

/// Tetrahedra of a ball, or -1 where the library has no mesher.
long tets_of_ball();
