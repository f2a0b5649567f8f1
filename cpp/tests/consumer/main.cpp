#include <cstdio>

#include "geometry.hpp"

int main() {
  const double error = largest_error();
  const bool refuses = refuses_open_surfaces();
  const long tets = tets_of_ball();
  std::printf("largest error %.1e, open surfaces %s, %ld tetrahedra\n", error, refuses ? "refused" : "taken", tets);
  return error < 1e-8 && refuses && tets != 0 ? 0 : 1;
}
