#include "systems/app/direction_trial.hpp"

#include <algorithm>

#include "content/build_scene.hpp"
#include "systems/app/capture.hpp"
namespace trocar {
namespace {

double deepest(const World& w) {
    return w.penetrations.depth.empty() ? 0 : *std::max_element(w.penetrations.depth.begin(), w.penetrations.depth.end());
}

}  // namespace

// Depths grow from pass to pass by little: only a pass after one nearly as deep as the deepest can become the deepest.
void DirectionTrial::before_pass() {
    state_.arrays.clear();
    if (!(depth_before_ > 0 && depth_before_ > 0.7 * record_)) return;
    save_resources(frame_.world(), ResourceKind::kState, state_);
    save_resources(frame_.world(), ResourceKind::kBooks, state_);
}

void DirectionTrial::after_pass(const PassFigures& pass) {
    depth_before_ = pass.depth;
    if (state_.arrays.empty() || !(pass.depth > record_)) return;
    record_ = pass.depth;
    std::swap(deepest_, state_);
}

World DirectionTrial::start() const {
    CaptureRecord constant;
    save_resources(frame_.world(), ResourceKind::kConstant, constant);
    World world;
    load_resources(constant, ResourceKind::kConstant, world);
    load_resources(deepest_, ResourceKind::kState, world);
    load_resources(deepest_, ResourceKind::kBooks, world);
    make_trees(world);
    return world;
}

// One frame for both: of ten thousand bodies each would take seconds to make.
DirectionFigures DirectionTrial::run() const {
    DirectionFigures figures;
    if (deepest_.arrays.empty()) return figures;
    FrameOptions options;
    options.pictures = false;
    Frame frame(start(), options);
    World& world = frame.world();
    figures.time = static_cast<double>(world.clock.tick) * 1e-3;
    for (const ResponseDirection direction : {ResponseDirection::kThesis, ResponseDirection::kLocal}) {
        load_resources(deepest_, ResourceKind::kState, world);
        load_resources(deepest_, ResourceKind::kBooks, world);
        world.settings.contact.direction = direction;
        frame.step();
        figures.depth = deepest(world);
        detect_contacts(world, false);
        (direction == ResponseDirection::kThesis ? figures.left_thesis : figures.left_local) = deepest(world);
    }
    return figures;
}

}  // namespace trocar
