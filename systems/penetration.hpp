#pragma once
#include "components/contacts.hpp"
namespace trocar {

// Penetration phase (thesis 4.2, FindPenetration): per candidate pair with a point on or inside the other surface, the
// largest of the shortest distances, the way b must go to leave a, the contact that says so and the counts. Ascending
// by pair; of equal depths the first contact is the witness. A pair that only touches has depth 0.
void measure_penetrations(const CandidatePairs& pairs, const Contacts& contacts, Penetrations& penetrations);

}  // namespace trocar
