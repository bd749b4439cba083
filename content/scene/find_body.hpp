#pragma once
#include "content/scene/scene_file.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// Index of the body of that name; kNone if there is none.
inline uint32_t find_body(const World& world, const std::string& name) {
    const auto found = std::find(world.bodies.name.begin(), world.bodies.name.end(), name);
    return found == world.bodies.name.end() ? kNone : static_cast<uint32_t>(found - world.bodies.name.begin());
}
// The same; without one it refuses the scene: "WHERE no body is named ...".
inline uint32_t find_body(const SceneFile& scene, uint32_t line, const World& world, const std::string& name,
                          const std::string& where = "") {
    const uint32_t body = find_body(world, name);
    if (body == kNone) refuse(scene, line, where + "no body is named \"" + name + "\"");
    return body;
}

// Index of the first element for which a test holds, or which is of a body; kNone if there is none.
template <typename Element, typename Test>
uint32_t find_index(const std::vector<Element>& list, const Test& test) {
    const auto found = std::find_if(list.begin(), list.end(), test);
    return found == list.end() ? kNone : static_cast<uint32_t>(found - list.begin());
}
template <typename Element>
uint32_t find_of_body(const std::vector<Element>& list, uint32_t body) {
    return find_index(list, [&](const Element& e) { return e.body == body; });
}

}  // namespace trocar
