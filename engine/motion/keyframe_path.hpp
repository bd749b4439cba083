#pragma once
#include <span>

#include "components/paths.hpp"
namespace trocar {

// Pose of a scripted body.
struct PathPoint {
    Vec3d position = Vec3d::Zero();  // m
    Quat orientation;
    Vec3d velocity = Vec3d::Zero();          // m/s
    Vec3d angular_velocity = Vec3d::Zero();  // rad/s, world axes
    double grip = 0;                         // rad, at rest at every key like the orientation
};

// Pose on a path at a time (s). Passes through every key with continuous velocity and never leaves the
// interval between two keys in any coordinate: monotone cubic (Fritsch & Butland, SIAM J. Sci. Stat. Comput.
// 5(2), 1984); orientation takes the shortest rotation and is at rest at every key. At rest before the first
// key, after the last and around a jump.
PathPoint sample_path(std::span<const Keyframe> keys, double time);

// Whether a jump happens in (from, to].
bool path_jumps(std::span<const Keyframe> keys, double from, double to);

}  // namespace trocar
