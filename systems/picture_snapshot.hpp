#pragma once
#include "components/contacts.hpp"
#include "components/haptics.hpp"
#include "components/picture.hpp"
#include "components/tears.hpp"
#include "engine/sleepers.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// Copies what a picture shows into `out`, whose capacity is reused. `normals` as compute_surface_normals gives them.
// A vertex gets the deepest of its contacts; both ends of an edge contact get that contact's depth. Contacts outside
// (distance >= 0) count as no depth. With `tears`, what cuts have removed is named. Non-finite vertices are copied as they are and left out
// of the boxes. Seen sleepers keep what they have in `out`.
void write_picture_snapshot(uint64_t number, double time, const Surfaces& surfaces, const SurfaceNormals& normals, const Contacts& contacts,
                            const Penetrations& penetrations, const Haptics& haptics, PictureSnapshot& out, const Tears* tears = nullptr,
                            const Sleepers& sleepers = {});

}  // namespace trocar
