#include "systems/detect/narrow/pierced_bodies.hpp"

#include <algorithm>

#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

// Body of the newest pierce event that a tick reported, or kNone.
uint32_t newest_pierced(const HapticEvents& events) {
    const uint64_t kept = std::min<uint64_t>(events.total, kKeptEvents);
    for (uint64_t n = events.total; n > events.total - kept; --n) {
        const HapticEvent& event = events.last[(n - 1) % kKeptEvents];
        if (event.kind == HapticEventKind::kPassThrough) return event.value;
    }
    return kNone;
}

}  // namespace

void find_pierced_bodies(std::span<const HandTool> tools, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> apart,
                         std::span<ToolState> states, std::vector<std::array<uint32_t, 2>>& pairs) {
    pairs.assign(apart.begin(), apart.end());
    for (size_t t = 0; t < tools.size(); ++t) {
        ToolPierce& pierce = states[t].pierce;
        const uint32_t count = states[t].events.count[static_cast<size_t>(HapticEventKind::kPassThrough)];
        if (count > pierce.seen) pierce.body = newest_pierced(states[t].events);
        pierce.seen = count;
        if (pierce.body == kNone) continue;
        const uint32_t own = tools[t].body, other = pierce.body;
        if (boxes_meet(boxes.box[own], boxes.box[other]))
            pairs.push_back({std::min(own, other), std::max(own, other)});
        else
            pierce.body = kNone;
    }
    if (pairs.size() > apart.size()) std::sort(pairs.begin(), pairs.end());
}

}  // namespace trocar
