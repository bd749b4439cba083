#pragma once
#include <span>

#include "components/contacts.hpp"
#include "components/detail.hpp"
#include "components/haptics.hpp"
namespace trocar {

// How the bodies of the rules are stepped in this pass: coarsely when the tips of all tools, and the eye where it counts, are
// farther than DetailRules::beyond from the body's box (m, with its margin) and the same goes for every body of its island: an
// island has one substep, which is short as soon as one of its bodies wants it short, and a tool's force goes through all of
// it. Nothing but the state decides, so the choice is the same for any number of threads and in every replay. Writes the rows
// of `stepping` that the rules name.
void choose_detail(const DetailRules& rules, const Islands& islands, const BodyBoxes& boxes, const Poses& poses,
                   std::span<const HandTool> tools, std::span<Stepping> stepping);

}  // namespace trocar
