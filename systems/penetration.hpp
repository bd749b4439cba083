#pragma once
#include "components/report.hpp"
#include "engine/contact_inputs.hpp"
namespace trocar {

// Penetration phase (thesis 4.2, FindPenetration): per candidate pair with a point on or inside the other surface, the
// largest of the shortest distances, the way b must go to leave a, the contact that says so and the counts. Ascending
// by pair; of equal depths the first contact is the witness. A pair that only touches has depth 0. Counts the pass.
void measure_penetrations(const CandidatePairs& pairs, const Contacts& contacts, Report& report, Penetrations& penetrations);

// Marks pairs so deep in each other that the depth and its direction say little about the way out:
// - the witness leaves nose first (nose_first.hpp), as when two balls have passed each other's centres: moving by the depth then
//   provably does not separate the bodies;
// - a tenth of the depth farther in it would not be deeper by nearly as much, and leave the other way: the medial axis lies
//   between;
// - another contact nearly as deep wants to leave the other way.
// One query a pair.
void mark_saturated(const ContactInputs& in, const Contacts& contacts, Penetrations& penetrations);

// Keeps, for every pair with contacts, the way that b would go to leave a, as it was in the last pass in which the pair was
// not saturated (that of the nearest contact while they do not overlap), and tells it to those that are now (way_out). One
// whose direction has turned against its memory counts as saturated too. A pair without contacts is forgotten; one
// saturated from the start gets the shortest of 27 ways that surely part it (b leaves the slab that holds a). `before` is
// scratch.
void remember_ways_out(const ContactInputs& in, const Contacts& contacts, PairMemory& before, PairMemory& memory,
                       Penetrations& penetrations);

// Both: finds the ways out of pairs that are deep in each other.
void find_ways_out(const ContactInputs& in, const Contacts& contacts, PairMemory& before, PairMemory& memory, Penetrations& penetrations);

}  // namespace trocar
