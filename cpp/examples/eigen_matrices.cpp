// For programs that have their meshes in Eigen's matrices, V (n x 3) and F (m x 3) as in libigl: maps points inside,
// and measures how the map changes volumes.
//
//   eigen_matrices                    a ball that becomes an egg
//   eigen_matrices DOMAIN IMAGE       surfaces of one connectivity
#include <Eigen/Core>
#include <Eigen/LU>
#include <cstdio>
#include <vector>

#include "solidmap/eigen.hpp"

int main(int argc, char** argv) {
  if (argc != 1 && argc != 3) {
    std::fprintf(stderr, "usage: eigen_matrices [DOMAIN IMAGE]\n");
    return 2;
  }
  try {
    const auto domain = argc == 3 ? solidmap::Surface::load(argv[1]) : solidmap::shapes::sphere(1.0, 3);
    // The matrices that such a program has.
    const Eigen::MatrixXd V = solidmap::eigen::matrix(domain.vertices());
    const Eigen::MatrixXi F = solidmap::eigen::triangles(domain);
    Eigen::MatrixXd image = V;
    if (argc == 3) {
      image = solidmap::eigen::matrix(solidmap::Surface::load(argv[2]).vertices());
    } else {
      image.col(0) = V.col(0).array() * (1.0 + 0.3 * V.col(2).array());
      image.col(1) = V.col(1).array() * (1.0 + 0.3 * V.col(2).array());
      image.col(2) *= 1.4;
    }

    const solidmap::BoundaryMap boundary(solidmap::eigen::surface(V, F), solidmap::eigen::points(image));
    const solidmap::HarmonicMap map = solidmap::fit(boundary);
    std::printf("fitted %td vertices, boundary error 99 %% %.1e of the target's size\n", V.rows(),
                map.boundary_error().p99);

    // Points halfway from the boundary to the middle, n x 3; their images; and the volume change there.
    const Eigen::RowVector3d middle = V.colwise().mean();
    const Eigen::MatrixXd inside = (0.5 * V).rowwise() + 0.5 * middle;
    const Eigen::MatrixXd carried = solidmap::eigen::evaluate(map, inside);
    std::printf("points halfway to the middle: in a box of %.3f x %.3f x %.3f, their images in one of %.3f x %.3f x %.3f\n",
                inside.col(0).maxCoeff() - inside.col(0).minCoeff(), inside.col(1).maxCoeff() - inside.col(1).minCoeff(),
                inside.col(2).maxCoeff() - inside.col(2).minCoeff(),
                carried.col(0).maxCoeff() - carried.col(0).minCoeff(),
                carried.col(1).maxCoeff() - carried.col(1).minCoeff(),
                carried.col(2).maxCoeff() - carried.col(2).minCoeff());
    const std::vector<solidmap::Matrix3> jacobians = map.jacobian(solidmap::eigen::points(inside));
    Eigen::VectorXd determinants(inside.rows());
    for (Eigen::Index i = 0; i < inside.rows(); ++i) {
      determinants[i] = solidmap::eigen::matrix(jacobians[static_cast<std::size_t>(i)]).determinant();
    }
    std::printf("volume change there: %.3f to %.3f\n", determinants.minCoeff(), determinants.maxCoeff());
    return determinants.allFinite() ? 0 : 1;
  } catch (const solidmap::Error& error) {
    std::fprintf(stderr, "error (%s): %s\n", solidmap::name(error.category()), error.what());
    return 1;
  }
}
