#pragma once
#include <Eigen/Geometry>

// Plain functions around Eigen's decompositions, which are slow to compile.
namespace trocar::reference {

// Of a symmetric matrix.
double largest_eigenvalue(const Eigen::MatrixXd& matrix);

// Solves matrix * x = right for a symmetric positive definite matrix.
Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& matrix, const Eigen::VectorXd& right);

// The rotation nearest to a matrix in the Frobenius norm, by singular value decomposition (Kabsch 1976).
Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& matrix);

}  // namespace trocar::reference
