#pragma once
#include <span>

#include "components/haptics.hpp"
#include "components/report.hpp"
#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// Tools that start or are found inside a body: from there contacts press on all sides and only glue the body to the
// tool. A tool without a valid proxy whose contacts are deeper than 2 mm (at its start 0.1 mm) gets an exit in its
// state: the direction in which all its inside points leave soonest, of 26 and the deepest contact's, found on the
// surfaces themselves (sphere tracing, Hart 1996). Until none is inside, contacts with it have no constraints and
// ticks move it out (push_out.hpp). Each find is counted.
void find_tools_inside(const ContactInputs& in, const Contacts& contacts, Haptics& haptics, Report& report);

}  // namespace trocar
