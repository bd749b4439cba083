#pragma once
#include <span>

#include "components/report.hpp"
#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// Penetration phase (thesis 4.2, FindPenetration): per broad-phase pair with a point on or inside the other
// surface, the largest of the shortest distances, b's separation direction, the witness contact (the first of
// equal depths) and the counts. Ascending by pair. A pair that only touches has depth 0. Counts the pass.
void measure_penetrations(const BroadPhasePairs& pairs, const Contacts& contacts, Report& report, Penetrations& penetrations);

// Marks pairs so deep that the depth and its direction say little about the separating translation:
// - the witness is an inverted contact (inverted_contact.hpp), as when two balls have passed each other's centres:
// moving by the depth then provably does not separate the bodies;
// - a tenth of the depth farther in, the point is hardly deeper and leaves in the opposite direction: the
// medial axis lies between;
// - another contact nearly as deep has the opposite direction. One query per pair.
void mark_saturated(const ContactInputs& in, const Contacts& contacts, Penetrations& penetrations);

// Stores, for every pair with contacts, b's separation direction in the last pass in which the pair was not
// saturated (of the nearest contact while they do not overlap), and gives it to the pairs that are saturated
// now (separation_direction). A pair whose direction has reversed since counts as saturated too. Forgets
// pairs without contacts; a pair saturated from the start gets the shortest of 27 translations that surely
// separate it (b leaves the slab around a). `before` is scratch.
void remember_separation_directions(const ContactInputs& in, const Contacts& contacts, PairMemory& before, PairMemory& memory,
                                    Penetrations& penetrations);

// The direction, of `tried`, 26 and the line between the middles, in which b leaves the slab around a soonest; `travel`: how far it
// goes until then, m.
Vec3d shortest_separation(const Surfaces& surfaces, uint32_t a, uint32_t b, std::span<const Vec3d> tried = {}, double* travel = nullptr);

// Marks overlapping pairs of a free and a rigid body as saturated if they are deeper than a hundredth of the smaller one, and gives them
// the direction of the shortest translation that separates them: shallow contacts push such a pair out at several sides at once.
// Free bodies deeper than the tolerance are not `still` (ms, Sleep::still; may be empty).
void part_rigid_pairs(const ContactInputs& in, const Contacts& contacts, Penetrations& penetrations, std::span<uint32_t> still);

// All: the separation directions of deep pairs; of those that are not rigid with DeepResponse::kLastFree.
void find_separation_directions(const ContactInputs& in, const Contacts& contacts, PairMemory& before, PairMemory& memory,
                                Penetrations& penetrations, std::span<uint32_t> still = {});

}  // namespace trocar
