#include "systems/prepare/rigid_motion.hpp"

#include "engine/motion/keyframe_path.hpp"
namespace trocar {

void follow_paths(const Paths& paths, double time, std::span<const uint8_t> off, Poses& poses) {
    for (uint32_t i = 0; i < paths.body.size(); ++i) {
        const PathPoint at = sample_path(std::span(paths.key).subspan(paths.keys[i].first, paths.keys[i].count), time);
        const uint32_t body = paths.body[i];
        if (body == kNone || (body < off.size() && off[body])) continue;  // moved by a device, or disabled
        poses.origin[body] = at.position;
        poses.orientation[body] = at.orientation;
        poses.velocity[body] = at.velocity;
        poses.angular_velocity[body] = at.angular_velocity;
    }
}

}  // namespace trocar
