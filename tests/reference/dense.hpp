#pragma once
#include <Eigen/Geometry>

// Eigen's decompositions, which are slow to compile, behind plain functions.
namespace trocar::reference {

// Of a symmetric matrix.
double largest_eigenvalue(const Eigen::MatrixXd& matrix);

// x of matrix x = right, matrix symmetric and positive definite.
Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& matrix, const Eigen::VectorXd& right);

// The rotation nearest to a matrix in the Frobenius norm, by its singular values (Kabsch 1976).
Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& matrix);

}  // namespace trocar::reference
