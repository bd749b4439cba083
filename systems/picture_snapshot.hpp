#pragma once
#include "components/contacts.hpp"
#include "components/haptics.hpp"
#include "components/lives.hpp"
#include "components/nodes.hpp"
#include "components/picture.hpp"
#include "components/tears.hpp"
#include "engine/sleepers.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// What a picture is made of.
struct PictureInputs {
    uint64_t number = 0;
    double time = 0;  // s
    Surfaces surfaces;
    const SurfaceNormals& normals;  // as compute_surface_normals gives them
    const Contacts& contacts;
    const Penetrations& penetrations;
    const Haptics& haptics;
    const Tears* tears = nullptr;           // names what cuts have removed; or null
    const Lives* lives = nullptr;           // empty slots are not drawn; or null
    const NodeState* node_state = nullptr;  // nor are bodies of disabled nodes; or null
};

// Copies what a picture shows into `out`, whose capacity is reused. A vertex gets the deepest of its contacts; both
// ends of an edge contact get that contact's depth. Contacts outside (distance >= 0) count as no depth. Non-finite vertices
// are copied as they are and left out of the boxes. Seen sleepers keep what they have in `out`.
void write_picture_snapshot(const PictureInputs& inputs, PictureSnapshot& out, const Sleepers& sleepers = {});

}  // namespace trocar
