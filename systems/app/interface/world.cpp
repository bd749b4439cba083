#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <mutex>

#include "content/scene/find_scene.hpp"
#include "engine/devices/device.hpp"
#include "engine/files/state_hash.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/app/interface/handles.hpp"
namespace trocar {
namespace {

thread_local char last_error[4096] = "";

std::mutex pool_mutex;
uint32_t wanted_threads = 0;
// Never freed: at the program's end the scheduler's own data may be gone before ours.
ThreadPool* pool = nullptr;
pid_t pool_process = 0;

uint64_t hash_of_scene(const World& world) {
    StateHash hash;
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
        if (resource_kind(static_cast<Resource>(r)) == ResourceKind::kConstant)
            hash.add_word(resource_hash(world, static_cast<Resource>(r)));
    return hash.value;
}

// A saved state as bytes: this head, then what pack makes.
struct StateHead {
    char mark[8] = {'t', 'r', 'o', 'c', 'a', 'r', 'S', '1'};
    uint64_t scene = 0;
    uint64_t bytes = 0;  // after the head
    uint64_t hash = 0;   // of them
};

uint64_t hash_of_bytes(const std::byte* bytes, size_t size) {
    StateHash hash;
    hash.add_bytes(bytes, size);
    return hash.value;
}

std::vector<std::byte> to_bytes(const SavedState& state, uint64_t scene) {
    std::vector<std::byte> all;
    pack(state, sizeof(StateHead), all);
    StateHead head;
    head.scene = scene, head.bytes = all.size() - sizeof head;
    head.hash = hash_of_bytes(all.data() + sizeof head, head.bytes);
    std::memcpy(all.data(), &head, sizeof head);
    return all;
}

void from_bytes(const std::byte* bytes, size_t size, uint64_t scene, SavedState& state) {
    StateHead head;
    const StateHead ours;
    if (size < sizeof head) throw InputError("not a saved state: too short");
    std::memcpy(&head, bytes, sizeof head);
    if (std::memcmp(head.mark, ours.mark, sizeof head.mark) != 0) throw InputError("not a saved state of this version");
    if (head.scene != scene) throw InputError("the saved state is of another scene, or of other overrides");
    const std::byte* const data = bytes + sizeof head;
    if (head.bytes != size - sizeof head || head.hash != hash_of_bytes(data, head.bytes)) throw InputError("the saved state is damaged");
    unpack({data, head.bytes}, state);
}

template <typename Visit>
void each_run_resource(const Visit& visit) {
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
        if (resource_kind(static_cast<Resource>(r)) == ResourceKind::kRun) visit(static_cast<Resource>(r));
}

void record_pass(trocar_world& world) {
    const World& w = world.frame.world();
    CaptureStep& step = world.recording->steps.emplace_back();
    step.pass = w.clock.pass - 1;
    step.state_hash = state_hash(w);
    const FrameTimes& times = world.frame.times();
    step.stage_ns = times.stage_ns;
    for (const uint64_t ns : times.stage_ns) step.frame_ms += 1e-6 * static_cast<double>(ns);
    for (const uint32_t stage : world.frame.detection_stages()) step.detection_ms += 1e-6 * static_cast<double>(times.stage_ns[stage]);
    step.response_ms = 1e-6 * static_cast<double>(times.response_ns);
    step.depth = times.deepest;
    for (const ToolState& tool : w.haptics.state) step.force = std::max(step.force, tool.output.force.norm());
    step.contacts = w.contacts.point.size();
    for (size_t p = 0; p < w.penetrations.pair.size(); ++p)
        step.inside_vertices += w.penetrations.vertices_a_in_b[p] + w.penetrations.vertices_b_in_a[p];
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
        step.resource_hash.push_back(resource_hash(w, static_cast<Resource>(r)));
}

void write_recording(const trocar_world& world, const Recording& r) {
    const World& w = world.frame.world();
    CaptureHeader header;
    header.scene = world.name, header.version = trocar_version(), header.reason = "recorded by a program";
    header.stages = world.frame.stage_names();
    header.camera = world.camera, header.wireframe = world.picture.wireframe, header.depth_colours = world.picture.depth_colours;
    CaptureWriter writer(r.file);
    writer.add(to_record(header));
    CaptureRecord scene{"scene", {}};
    save_resources(w, ResourceKind::kConstant, scene);  // with the traces of all tools until now
    writer.add(scene);
    writer.add(r.state);
    for (const CaptureStep& step : r.steps) writer.add(to_record(step));
    writer.finish();
}

}  // namespace

void set_last_error(const char* text) noexcept { std::snprintf(last_error, sizeof last_error, "%s", text); }

void on_threads(const std::function<void()>& work) {
    {
        const std::scoped_lock lock(pool_mutex);
        if (pool && pool_process != getpid())
            throw BadCall("a forked child has none of its parent's threads: start it anew (Python: multiprocessing's \"spawn\")");
        if (!pool) pool = new ThreadPool(wanted_threads), pool_process = getpid();
    }
    pool->run(work);
}

trocar_code fill_text(const std::string& text, char* out, size_t capacity, size_t* length) {
    return fill(out, capacity, length, text.size() + 1, 1, [&](size_t i, char* c) { *c = text.c_str()[i]; });
}

SceneFile read_asked_scene(const trocar_scene& scene) {
    std::vector<Override> overrides;
    if (scene.set_count > 0) needed(scene.set, "scene.set");
    for (uint32_t i = 0; i < scene.set_count; ++i) {
        const std::string word = &needed(scene.set[i], "an entry of scene.set");
        const size_t equal = word.find('=');
        if (equal == std::string::npos || equal == 0) throw InputError("set \"" + word + "\": write key=value");
        overrides.push_back({word.substr(0, equal), word.substr(equal + 1)});
    }
    if (scene.text) return read_scene_text(scene.text, scene.file ? scene.file : "scene", overrides);
    if (!scene.file) throw BadCall("scene: neither file nor text is set");
    return read_scene_file(find_scene(scene.file), overrides);
}

std::unique_ptr<trocar_world> make_world(const trocar_scene& scene, const SceneFile& file) {
    BuiltScene built = build_scene(file, scene.paint ? Looks::kPainted : Looks::kPlain);
    FrameOptions options;
    options.pictures = false;
    auto world = std::make_unique<trocar_world>(std::move(built.world), options);
    const World& w = world->frame.world();
    world->name = file.settings.name;
    for (const std::string& warning : built.warnings) world->warnings += warning + "\n";
    world->camera = built.camera, world->picture = built.picture;
    world->scene_hash = hash_of_scene(w);
    for (const HandTool& tool : w.haptics.tool) world->motion.emplace_back().script = tool.trace;
    each_array(
        w, [](void* user, const WorldArray& a) { static_cast<trocar_world*>(user)->array_names.push_back(a.name); }, world.get());
    return world;
}

void pack(const SavedState& state, size_t head, std::vector<std::byte>& all) {
    size_t size = head + state.motion.size() * sizeof(MotionNumbers);
    for (const CaptureArray& a : state.record.arrays) size += sizeof a.rows + padded(a.bytes.size());
    if (all.capacity() < size) all = {}, all.reserve(size + size / 16);  // many such are kept: no doubling
    all.resize(size);
    std::byte* to = all.data() + head;
    const auto add = [&](const void* data, size_t count) {
        if (count > 0) std::memcpy(to, data, count);
        to += count;
    };
    for (const ToolMotion& m : state.motion) {
        const MotionNumbers numbers = to_numbers(m);
        add(numbers.data(), sizeof numbers);
    }
    for (const CaptureArray& a : state.record.arrays) {
        constexpr uint64_t kZero = 0;
        add(&a.rows, sizeof a.rows);
        add(a.bytes.data(), a.bytes.size());
        add(&kZero, padded(a.bytes.size()) - a.bytes.size());
    }
}

void unpack(std::span<const std::byte> from, SavedState& state) {
    const auto take = [&](void* to, size_t count) {
        if (count > from.size()) throw InputError("the saved state is damaged");
        if (count > 0) std::memcpy(to, from.data(), count);
        from = from.subspan(count);
    };
    for (ToolMotion& m : state.motion) {
        MotionNumbers numbers;
        take(numbers.data(), sizeof numbers);
        from_numbers(numbers, m);
    }
    for (CaptureArray& a : state.record.arrays) {
        take(&a.rows, sizeof a.rows);
        const size_t row = a.columns * element_size(a.type);
        if (a.rows > from.size() / row) throw InputError("the saved state is damaged");
        a.bytes.resize(a.rows * row);
        take(a.bytes.data(), a.bytes.size());
        uint64_t zero = 0;
        take(&zero, padded(a.bytes.size()) - a.bytes.size());
    }
    if (!from.empty()) throw InputError("the saved state is damaged");
}

void save(const trocar_world& world, SavedState& state) {
    const World& w = world.frame.world();
    save_state(w, state.record);
    each_run_resource([&](Resource r) { save_resource(w, r, state.record); });
    state.motion = world.motion;
}

void restore(const SavedState& state, bool forget, trocar_world& world) {
    World& w = world.frame.world();
    load_resources(state.record, ResourceKind::kState, w);
    load_resources(state.record, ResourceKind::kAccounts, w);
    each_run_resource([&](Resource r) { load_resource(state.record, r, w); });
    for (size_t t = 0; t < world.motion.size(); ++t) {
        const uint32_t trace = world.motion[t].trace;  // rows of this world
        world.motion[t] = state.motion[t];
        world.motion[t].trace = trace;
    }
    if (forget) {
        w.contacts = {}, w.penetrations = {}, w.regions = {}, w.contours = {};
    }
    world.frame.state_replaced();
}

void step_passes(uint32_t passes, trocar_world& world) {
    for (uint32_t p = 0; p < passes; ++p) {
        write_traces(world.motion, world.recording != nullptr, world.frame.world());
        world.frame.step();
        if (world.recording) record_pass(world);
    }
}

trocar_view view_of(const WorldArray& array) {
    trocar_view view{};
    view.type = static_cast<uint32_t>(array.type);
    view.data = array.rows > 0 ? const_cast<void*>(array.data) : nullptr;
    view.rows = array.rows, view.columns = array.columns, view.fixed = array.fixed;
    view.writable = (mask(array.resource) & mask(Resource::kPoses, Resource::kParticles)) != 0;
    std::snprintf(view.unit, sizeof view.unit, "%.*s", static_cast<int>(array.unit.size()), array.unit.data());
    return view;
}

namespace {

// The world of a call that a world lent by a batch does not take.
trocar_world& own_world(trocar_world* world) {
    if (needed(world, "world").of_batch) throw BadCall("a world of a batch: step the batch");
    return *world;
}

}  // namespace
}  // namespace trocar

using namespace trocar;

const char* trocar_last_error(void) { return last_error; }
uint32_t trocar_abi(void) { return TROCAR_ABI; }

trocar_code trocar_set_threads(uint32_t threads) {
    return guarded([&] {
        const std::scoped_lock lock(pool_mutex);
        if (pool) throw BadCall("threads: set them before the first world, batch or collider");
        wanted_threads = threads;
        return TROCAR_OK;
    });
}

trocar_code trocar_open(const trocar_scene* scene, trocar_world** world) {
    return guarded([&] {
        needed(world, "world") = nullptr;
        const trocar_scene asked = taken(scene, "scene");
        const SceneFile file = read_asked_scene(asked);
        std::unique_ptr<trocar_world> made;
        on_threads([&] {
            made = make_world(asked, file);
            save(*made, made->start);
        });
        *world = made.release();
        return TROCAR_OK;
    });
}

void trocar_close(trocar_world* world) {
    if (world && !world->of_batch) guarded([&] { return on_threads([&] { delete world; }), TROCAR_OK; });
}

trocar_code trocar_warnings(const trocar_world* world, char* text, size_t capacity, size_t* length) {
    return guarded([&] { return fill_text(needed(world, "world").warnings, text, capacity, length); });
}

trocar_code trocar_step(trocar_world* world, uint32_t passes) {
    return guarded([&] {
        trocar_world& w = own_world(world);
        on_threads([&] { step_passes(passes, w); });
        return TROCAR_OK;
    });
}

trocar_code trocar_step_until(trocar_world* world, double seconds) {
    return guarded([&] {
        trocar_world& w = own_world(world);
        if (!std::isfinite(seconds)) throw InputError("seconds: not a finite number");
        on_threads([&] {
            while (static_cast<double>(w.frame.world().clock.tick) < 1e3 * seconds) step_passes(1, w);
        });
        return TROCAR_OK;
    });
}

double trocar_time(const trocar_world* world) { return world ? static_cast<double>(world->frame.world().clock.tick) * 1e-3 : -1; }

trocar_code trocar_hash(const trocar_world* world, uint64_t* hash) {
    return guarded([&] {
        needed(hash, "hash") = state_hash(needed(world, "world").frame.world());
        return TROCAR_OK;
    });
}

trocar_code trocar_save(const trocar_world* world, void* bytes, size_t capacity, size_t* length) {
    return guarded([&] {
        SavedState state;
        save(needed(world, "world"), state);
        const std::vector<std::byte> all = to_bytes(state, world->scene_hash);
        needed(length, "length") = all.size();
        if (all.size() > capacity) {
            set_last_error("the buffer is too small for the state");
            return TROCAR_TOO_SMALL;
        }
        std::memcpy(&needed(static_cast<std::byte*>(bytes), "bytes"), all.data(), all.size());
        return TROCAR_OK;
    });
}

trocar_code trocar_restore(trocar_world* world, const void* bytes, size_t length) {
    return guarded([&] {
        SavedState state;
        save(needed(world, "world"), state);
        from_bytes(&needed(static_cast<const std::byte*>(bytes), "bytes"), length, world->scene_hash, state);
        if (world->recording) throw BadCall("the world records: end that first");
        on_threads([&] { restore(state, true, *world); });
        return TROCAR_OK;
    });
}

trocar_code trocar_reset(trocar_world* world) {
    return guarded([&] {
        if (needed(world, "world").recording) throw BadCall("the world records: end that first");
        on_threads([&] { restore(world->start, true, *world); });
        return TROCAR_OK;
    });
}

uint32_t trocar_array_count(const trocar_world* world) { return world ? static_cast<uint32_t>(world->array_names.size()) : 0; }
const char* trocar_array_name(const trocar_world* world, uint32_t index) {
    return index < trocar_array_count(world) ? world->array_names[index].c_str() : nullptr;
}

trocar_code trocar_array(trocar_world* world, const char* name, trocar_view* view) {
    return guarded([&] {
        const std::string asked = &needed(name, "name");
        const std::optional<WorldArray> found = find_array(needed(world, "world").frame.world(), asked);
        if (!found) throw BadCall("no array is named \"" + asked + "\": trocar_array_name lists them");
        give(view_of(*found), view, "view");
        return TROCAR_OK;
    });
}

trocar_code trocar_record(trocar_world* world, const char* file) {
    return guarded([&] {
        trocar_world& w = own_world(world);
        if (w.recording) {
            const std::unique_ptr<Recording> done = std::move(w.recording);
            if (!done->steps.empty()) write_recording(w, *done);
        }
        if (!file) return TROCAR_OK;
        auto recording = std::make_unique<Recording>();
        recording->file = file;
        CaptureWriter probe(recording->file);  // fails now rather than at the end
        save_state(w.frame.world(), recording->state);
        for (ToolMotion& m : w.motion)
            if (m.trace != kNone) w.frame.world().haptics.trace[m.trace].sample.clear();
        w.recording = std::move(recording);
        return TROCAR_OK;
    });
}
