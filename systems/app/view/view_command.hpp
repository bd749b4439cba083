#pragma once
#include <cstdint>
#include <string>

#include "components/math.hpp"
namespace trocar {

// What a viewer does to a run besides its buttons. With the pass that it came before, enough to repeat it.
struct ViewCommand {
    // kSet: a marked parameter gets another value. kGrab: a hand takes hold of a body's surface, kPull: and goes there, kLet: and lets go.
    // kBleed: a vessel opens there on a body's surface. kSlip: the staple that is nearest slips off.
    enum class Kind : uint8_t { kSet, kGrab, kPull, kLet, kBleed, kSlip };
    uint64_t pass = 0;  // number of passes made before it
    Kind kind = Kind::kLet;
    std::string key, value;       // kSet
    uint32_t body = 0;            // kGrab, kBleed
    Vec3d point = Vec3d::Zero();  // m, world: all but kSet, kLet
    double rate = 0;              // m^3/s: kBleed
};

// One line of JSON, {"do": "set" | "grab" | "pull" | "let" | "bleed" | "slip", ...}: every number is read back to the bit.
std::string text_of(const ViewCommand& command);

// Reads such a line; throws InputError that says what is missing or of another type. Numbers are finite; whether there is such a body or
// key shows when it is obeyed.
ViewCommand read_view_command(const std::string& text);

}  // namespace trocar
