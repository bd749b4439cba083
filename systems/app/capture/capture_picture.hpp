#pragma once
#include <cstddef>
#include <vector>

#include "engine/world/capture_record.hpp"
namespace trocar {

// The picture inside a capture: what its last pass looked like.
struct CapturePicture {
    uint64_t pass = 0;         // at whose end
    std::vector<uint8_t> png;  // kCapturePictureWidth x kCapturePictureHeight; empty = none
};
inline constexpr uint32_t kCapturePictureWidth = 320, kCapturePictureHeight = 240;

// What is drawn of a world, copied.
PictureSnapshot snapshot_of(const World& world);
// Draws it as the scene's camera sees it, from the meshes as they were when the scene was built: the record "picture" of a capture.
// Without a picture where it cannot be drawn (a world that broke).
CaptureRecord picture_record(const PictureSnapshot& snapshot, const Meshes& meshes, const CaptureHeader& header, uint64_t pass);
CapturePicture read_picture(const CaptureRecord& record);

}  // namespace trocar
