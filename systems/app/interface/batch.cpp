#include <atomic>
#include <optional>
#include <thread>

#include "engine/jobs/thread_pool.hpp"
#include "systems/app/interface/handles.hpp"

// Worlds are states; each thread has one whole world, the lender, into which it loads the state that it steps.
struct trocar_batch {
    struct One {
        std::vector<std::byte> state;            // packed
        std::vector<trocar::CaptureArray> kept;  // of trocar_batch::keep
    };
    std::vector<std::unique_ptr<trocar_world>> lender;
    std::vector<One> world;
    std::vector<std::string> keep;
    uint32_t lent = trocar::kNone;  // whose state the first lender has for a caller
};

namespace trocar {
namespace {

// A world of the same scene, with all that is constant copied, at the same state.
std::unique_ptr<trocar_world> copy_world(const trocar_world& from, const SavedState& state) {
    const World& w = from.frame.world();
    CaptureRecord scene{"scene", {}};
    save_resources(w, ResourceKind::kConstant, scene);
    World copy;
    load_resources(scene, ResourceKind::kConstant, copy);
    load_resources(state.record, ResourceKind::kState, copy);
    load_resources(state.record, ResourceKind::kAccounts, copy);
    copy.settings.name = w.settings.name, copy.settings.description = w.settings.description;
    make_trees(copy);
    FrameOptions options;
    options.pictures = false;
    auto world = std::make_unique<trocar_world>(std::move(copy), options);
    world->name = from.name, world->camera = from.camera, world->picture = from.picture;
    world->scene_hash = from.scene_hash, world->motion = from.motion, world->array_names = from.array_names;
    restore(state, true, *world);
    return world;
}

CaptureArray copy_array(const WorldArray& a) {
    CaptureArray copy{a.name, a.type, a.rows, a.columns, {}};
    const std::byte* from = static_cast<const std::byte*>(a.data);
    if (a.rows > 0) copy.bytes.assign(from, from + a.rows * a.columns * element_size(a.type));
    return copy;
}

void keep_arrays(const trocar_world& lender, const std::vector<std::string>& names, std::vector<CaptureArray>& kept) {
    kept.clear();
    for (const std::string& name : names) kept.push_back(copy_array(*find_array(lender.frame.world(), name)));
}

void load(const trocar_batch::One& one, bool forget, trocar_world& lender) {
    unpack(one.state, lender.now);
    restore(lender.now, forget, lender);
}
void store(trocar_world& lender, trocar_batch::One& one) {
    save(lender, lender.now);
    pack(lender.now, 0, one.state);
}

// Takes back what a caller changed in the world lent to it.
void take_back(trocar_batch& batch) {
    if (batch.lent == kNone) return;
    store(*batch.lender[0], batch.world[batch.lent]);
    batch.lent = kNone;
}

// Steps worlds, one after the other, until none is left; the first failure of any thread is kept.
void step_worlds(trocar_batch& batch, uint32_t passes, trocar_world& lender, std::atomic<uint32_t>& next, std::exception_ptr& failure) {
    const FloatModeScope ours;
    try {
        for (uint32_t i; (i = next++) < batch.world.size();) {
            trocar_batch::One& one = batch.world[i];
            load(one, false, lender);
            step_passes(passes, lender);
            store(lender, one);
            keep_arrays(lender, batch.keep, one.kept);
        }
    } catch (...) {
        failure = std::current_exception();
        next = static_cast<uint32_t>(batch.world.size());
    }
}

size_t bytes_of(const CaptureRecord& record) {
    size_t bytes = record.arrays.capacity() * sizeof(CaptureArray);
    for (const CaptureArray& a : record.arrays) bytes += a.bytes.capacity() + (a.name.size() > 15 ? a.name.capacity() : 0);
    return bytes;
}

uint64_t bytes_of_constants(const World& w) {
    CaptureRecord scene{"scene", {}};
    save_resources(w, ResourceKind::kConstant, scene);
    return bytes_of(scene);
}

trocar_batch::One& world_at(trocar_batch* batch, uint32_t index) {
    const size_t count = needed(batch, "batch").world.size();
    if (index >= count) throw BadCall("world " + std::to_string(index) + " of a batch of " + std::to_string(count));
    return batch->world[index];
}

// Rows and bytes of an array within a packed state; `like` has names and types.
std::optional<std::pair<uint64_t, const std::byte*>> find_packed(const std::vector<std::byte>& packed, const SavedState& like,
                                                                 const std::string& name) {
    const std::byte* at = packed.data() + like.motion.size() * sizeof(MotionNumbers);
    for (const CaptureArray& a : like.record.arrays) {
        uint64_t rows = 0;
        std::memcpy(&rows, at, sizeof rows);
        at += sizeof rows;
        if (a.name == name) return std::pair{rows, at};
        at += padded(rows * a.columns * element_size(a.type));
    }
    return {};
}

}  // namespace
}  // namespace trocar

using namespace trocar;

trocar_code trocar_batch_open(const trocar_scene* scene, uint32_t worlds, uint32_t threads, trocar_batch** batch) {
    return guarded([&] {
        needed(batch, "batch") = nullptr;
        const trocar_scene asked = taken(scene, "scene");
        if (worlds == 0) throw BadCall("a batch of no world");
        const SceneFile file = read_asked_scene(asked);
        if (threads == 0) threads = std::max(1u, std::thread::hardware_concurrency());
        auto made = std::make_unique<trocar_batch>();
        on_threads([&] {
            made->lender.push_back(make_world(asked, file));
            SavedState start;
            save(*made->lender[0], start);
            while (made->lender.size() < std::min(threads, worlds)) made->lender.push_back(copy_world(*made->lender[0], start));
            for (auto& lender : made->lender) lender->of_batch = true, lender->now = start;
            made->lender[0]->start = start;  // of trocar_reset
            made->world.resize(worlds);
            for (trocar_batch::One& one : made->world) pack(start, 0, one.state);
        });
        *batch = made.release();
        return TROCAR_OK;
    });
}

void trocar_batch_close(trocar_batch* batch) {
    if (batch) guarded([&] { return on_threads([&] { delete batch; }), TROCAR_OK; });
}

uint32_t trocar_batch_count(const trocar_batch* batch) { return batch ? static_cast<uint32_t>(batch->world.size()) : 0; }

trocar_code trocar_batch_step(trocar_batch* batch, uint32_t passes) {
    return guarded([&] {
        trocar_batch& b = needed(batch, "batch");
        take_back(b);
        std::atomic<uint32_t> next = 0;
        std::vector<std::exception_ptr> failure(b.lender.size());
        std::vector<std::jthread> others;
        // outside of the pool: a world is stepped by one thread
        for (size_t t = 1; t < b.lender.size(); ++t)
            others.emplace_back([&, t] { step_worlds(b, passes, *b.lender[t], next, failure[t]); });
        step_worlds(b, passes, *b.lender[0], next, failure[0]);
        others.clear();
        for (const std::exception_ptr& one : failure)
            if (one) std::rethrow_exception(one);
        return TROCAR_OK;
    });
}

trocar_code trocar_batch_world(trocar_batch* batch, uint32_t index, trocar_world** world) {
    return guarded([&] {
        needed(world, "world") = nullptr;
        world_at(batch, index);
        if (batch->lent != index) {
            take_back(*batch);
            on_threads([&] { load(batch->world[index], true, *batch->lender[0]); });
            batch->lent = index;
        }
        *world = batch->lender[0].get();
        return TROCAR_OK;
    });
}

trocar_code trocar_batch_keep(trocar_batch* batch, const char* array) {
    return guarded([&] {
        const std::string name = &needed(array, "array");
        trocar_batch& b = needed(batch, "batch");
        if (!find_array(b.lender[0]->frame.world(), name)) throw BadCall("no array is named \"" + name + "\"");
        if (std::ranges::find(b.keep, name) == b.keep.end()) b.keep.push_back(name);
        return TROCAR_OK;
    });
}

trocar_code trocar_batch_array(trocar_batch* batch, uint32_t index, const char* array, trocar_view* view) {
    return guarded([&] {
        trocar_batch::One& one = world_at(batch, index);
        const std::string name = &needed(array, "array");
        trocar_world& lender = *batch->lender[0];
        const std::optional<WorldArray> own = find_array(lender.frame.world(), name);
        if (!own) throw BadCall("no array is named \"" + name + "\"");
        trocar_view v = view_of(*own);
        v.fixed = v.writable = 0;
        if (const auto kept = std::ranges::find(one.kept, name, &CaptureArray::name); kept != one.kept.end()) {
            v.rows = kept->rows, v.data = kept->bytes.data();
        } else {
            if (batch->lent == index) store(lender, one);
            const std::optional<std::pair<uint64_t, const std::byte*>> found = find_packed(one.state, lender.now, name);
            if (!found) throw BadCall("\"" + name + "\" is neither an array of the state nor kept from the last step: trocar_batch_keep");
            v.rows = found->first, v.data = const_cast<std::byte*>(found->second);
        }
        if (v.rows == 0) v.data = nullptr;
        give(v, view, "view");
        return TROCAR_OK;
    });
}

trocar_code trocar_batch_memory(const trocar_batch* batch, uint64_t* each, uint64_t* shared) {
    return guarded([&] {
        const trocar_batch& b = needed(batch, "batch");
        const trocar_batch::One& one = b.world.front();
        needed(each, "each") = sizeof one + one.state.capacity();
        needed(shared, "shared") = bytes_of_constants(b.lender[0]->frame.world()) * b.lender.size();
        return TROCAR_OK;
    });
}
