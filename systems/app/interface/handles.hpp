#pragma once
#include <algorithm>
#include <cstddef>
#include <cstring>
#include <exception>
#include <functional>
#include <memory>
#include <new>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "components/picture.hpp"
#include "content/scene/build_scene.hpp"
#include "engine/base/error.hpp"
#include "engine/files/capture_file.hpp"
#include "engine/world/arrays.hpp"
#include "engine/world/capture_record.hpp"
#include "systems/app/interface/tool_motion.hpp"
#include "systems/app/interface/trocar/trocar.h"
#include "systems/frame/frame.hpp"
#include "systems/output/render.hpp"
namespace trocar {

// The state of a world between two passes, with what a program told its tools.
struct SavedState {
    CaptureRecord record;
    std::vector<ToolMotion> motion;
};

// Passes recorded for a capture.
struct Recording {
    std::string file;
    CaptureRecord state;  // at its start
    std::vector<CaptureStep> steps;
};

// Draws pictures of one world.
struct Painter {
    explicit Painter(const Meshes& meshes) : renderer(meshes) {}
    GlRenderer renderer;
    RenderScratch scratch;
    Camera camera;  // of the scene, fitted at the first picture
    bool placed = false, fitted = false;
    Image image;
};

}  // namespace trocar

struct trocar_world {
    trocar_world(trocar::World built, const trocar::FrameOptions& options) : frame(std::move(built), options) {}
    std::string name, warnings;
    trocar::Camera camera;
    trocar::PictureParams picture;
    trocar::Frame frame;
    uint64_t scene_hash = 0;
    std::vector<trocar::ToolMotion> motion;  // per tool
    trocar::SavedState start;
    trocar::SavedState now;  // reused memory
    bool of_batch = false;
    std::vector<std::string> array_names;
    std::unique_ptr<trocar::Recording> recording;
    std::unique_ptr<trocar::Painter> painter;
};

namespace trocar {

// A call that names what is not there. Becomes TROCAR_BAD_CALL.
struct BadCall : std::runtime_error {
    using std::runtime_error::runtime_error;
};

void set_last_error(const char* text) noexcept;

// Runs the body of a function of the interface; nothing is thrown beyond it.
template <typename Body>
trocar_code guarded(const Body& body) noexcept {
    set_last_error("");
    try {
        return body();
    } catch (const BadCall& error) {
        set_last_error(error.what());
        return TROCAR_BAD_CALL;
    } catch (const InputError& error) {
        set_last_error(error.what());
        return TROCAR_BAD_INPUT;
    } catch (const std::bad_alloc&) {
        set_last_error("no memory");
        return TROCAR_NO_MEMORY;
    } catch (const std::exception& error) {
        set_last_error(error.what());
        return TROCAR_INTERNAL;
    } catch (...) {
        set_last_error("an unknown fault");
        return TROCAR_INTERNAL;
    }
}

// Runs work on the library's threads, which start with the first such call. Throws BadCall in a forked child: threads do not
// survive a fork.
void on_threads(const std::function<void()>& work);

template <typename T>
T& needed(T* pointer, const char* what) {
    if (!pointer) throw BadCall(std::string(what) + " is null");
    return *pointer;
}

// Copies a struct of the caller, whose size says how much of it there is, into ours; members beyond it stay zero.
template <typename T>
T taken(const T* given, const char* what) {
    const uint32_t size = needed(given, what).size;
    if (size < sizeof(uint32_t) || size > (1u << 16)) throw BadCall(std::string(what) + ": its size is not set");
    T own{};
    std::memcpy(static_cast<void*>(&own), given, std::min<size_t>(size, sizeof(T)));
    return own;
}
// The reverse: fills as much of the caller's struct as it has.
template <typename T>
void give(const T& own, T* out, const char* what) {
    const uint32_t size = needed(out, what).size;
    if (size < sizeof(uint32_t) || size > (1u << 16)) throw BadCall(std::string(what) + ": its size is not set");
    std::memcpy(static_cast<void*>(out), &own, std::min<size_t>(size, sizeof(T)));
    out->size = size;
}

// Tells the count of a list, and fills it if it has the capacity.
template <typename T, typename Make>
trocar_code fill(T* out, size_t capacity, size_t* count, size_t there, size_t width, const Make& make) {
    needed(count, "count") = there;
    if (there > capacity) {
        set_last_error(("room for " + std::to_string(capacity) + ", there are " + std::to_string(there)).c_str());
        return TROCAR_TOO_SMALL;
    }
    if (there > 0) needed(out, "out");
    for (size_t i = 0; i < there; ++i) make(i, out + i * width);
    return TROCAR_OK;
}
trocar_code fill_text(const std::string& text, char* out, size_t capacity, size_t* length);

inline void put(const Vec3d& v, double* out) { out[0] = v.x(), out[1] = v.y(), out[2] = v.z(); }
inline Vec3d vector_at(const double* v) { return {v[0], v[1], v[2]}; }
inline void put(const Quat& q, double* out) { out[0] = q.w, out[1] = q.x, out[2] = q.y, out[3] = q.z; }

// Scene as asked for; reads its file.
SceneFile read_asked_scene(const trocar_scene& scene);
// A world of a scene at its start, built on the caller's pool.
std::unique_ptr<trocar_world> make_world(const trocar_scene& scene, const SceneFile& file);

void save(const trocar_world& world, SavedState& state);
// Bytes of an array of a packed state: whole words, so that every array is aligned.
inline size_t padded(size_t bytes) { return (bytes + 7) / 8 * 8; }
// A state as bytes after `head` free ones: the motions of the tools, then every array: number of rows,
// its bytes, padded. And back into any
// state of the same scene, which knows names and types. Throws InputError if sizes do not fit.
void pack(const SavedState& state, size_t head, std::vector<std::byte>& bytes);
void unpack(std::span<const std::byte> bytes, SavedState& state);
// `forget`: empties what the last pass derived.
void restore(const SavedState& state, bool forget, trocar_world& world);
// Passes without records.
void step_passes(uint32_t passes, trocar_world& world);

trocar_view view_of(const WorldArray& array);

// One row of a contact or pair, as the interface has it.
void put_contact(const Contacts& contacts, size_t row, trocar_contact& out);
void put_pair(const World& world, uint32_t pair, size_t row, trocar_pair& out);  // row of Penetrations, or beyond it

}  // namespace trocar
