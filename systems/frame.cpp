#include "systems/frame.hpp"

#include <algorithm>
#include <string>

#include "engine/error.hpp"
#include "engine/parallel.hpp"
#include "engine/thread_pool.hpp"
#include "engine/trace.hpp"
#include "systems/frame_stages.hpp"
#include "systems/tear_bodies.hpp"
namespace trocar {
namespace {

bool any_path(const World& w) {
    return std::any_of(w.paths.body.begin(), w.paths.body.end(), [](uint32_t body) { return body != kNone; });
}
bool any_switch(const World& w) { return !w.nodes.toggle.empty() || !w.nodes.exchange.empty(); }
bool any_pool(const World& w) { return !w.pools.slots.empty(); }
bool any_tool(const World& w) { return !w.haptics.tool.empty(); }
bool any_pair(const World& w) {
    return w.bodies.motion.size() > 1 && std::any_of(w.bodies.motion.begin(), w.bodies.motion.end(), joins_islands);
}
bool wants_regions(const World& w) { return w.settings.contact.regions && any_pair(w); }
bool wants_contours(const World& w) { return (w.settings.contact.contours && any_pair(w)) || wants_regions(w); }
bool wants_faces(const World& w) { return w.settings.contact.faces && any_pair(w); }
bool wants_ways_out(const World& w) { return w.settings.contact.deep != DeepResponse::kNone && any_pair(w); }
bool any_mover(const World& w) { return any_tool(w) || std::any_of(w.bodies.motion.begin(), w.bodies.motion.end(), joins_islands); }
bool any_deformable(const World& w) { return !w.particles.offset.empty(); }
bool any_energy(const World& w) { return any_deformable(w) || !w.bodies.rigid_mass.empty(); }
bool any_body(const World& w) { return !w.bodies.mesh.empty(); }

bool any_link(const World& w) { return !w.links.group.empty(); }
bool any_tear(const World& w) { return !w.tears.body.empty(); }
bool anyone_sleeps(const World& w) { return any_energy(w) && w.settings.sleep_speed > 0; }

using R = Resource;
constexpr ResourceMask kShapes = mask(R::kMeshes, R::kBodies, R::kPoses, R::kParticles);

// clang-format off
constexpr FrameStage kBegin[] = {
    // name              run              reads                                                              writes
    {{"device input",    stages::device_input,    mask(R::kClock, R::kPaths, R::kTools),                             mask(R::kToolState)}, any_tool},
    {{"nodes",           stages::nodes,           mask(R::kClock, R::kNodes, R::kTools, R::kLives), mask(R::kPoses, R::kToolState, R::kNodeState, R::kSleep)}, any_switch},
    {{"rigid motion",    stages::rigid_motion,    mask(R::kClock, R::kPaths, R::kNodeState),                                        mask(R::kPoses)}, any_path},
    {{"come and go",     stages::come_and_go,     kShapes | mask(R::kSettings, R::kSprings, R::kSolids, R::kAnchors, R::kPools, R::kClock), mask(R::kPoses, R::kParticles, R::kSleep, R::kLives, R::kEnergy)}, any_pool},
    {{"links",           stages::link,            kShapes | mask(R::kSolids, R::kClock, R::kTrees, R::kToolState),     mask(R::kLinks, R::kSleep, R::kEnergy, R::kReport)}, any_link},
    {{"tears",           stages::tear,            mask(R::kSettings, R::kClock, R::kSprings, R::kSolids, R::kBodies, R::kPoses, R::kAnchors), mask(R::kParticles, R::kMeshes, R::kTrees, R::kTears, R::kTorn, R::kTornSprings, R::kSleep, R::kEnergy, R::kReport)}, any_tear},
    {{"body boxes",      stages::body_boxes,      kShapes | mask(R::kSettings, R::kClock, R::kTools, R::kToolState, R::kLives, R::kNodeState, R::kSleep), mask(R::kBoxes)}, any_pair},
    {{"candidate pairs", stages::candidate_pairs, kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kNodes, R::kTools), mask(R::kPairs, R::kToolState)}, any_pair},
    {{"sleep",           stages::sleep,           mask(R::kSettings, R::kBodies, R::kPaths, R::kClock, R::kPairs, R::kLinks, R::kTools, R::kNodes, R::kLives), mask(R::kSleep, R::kParticles, R::kPoses, R::kPairs, R::kEnergy, R::kReport)}, anyone_sleeps},
    {{"refit trees",     stages::refit,           kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs),            mask(R::kTrees)}, any_pair},
    {{"rasterise",       stages::rasterise_bodies,      kShapes | mask(R::kSettings, R::kBoxes, R::kPairs),                mask(R::kScreened, R::kOccupancy, R::kReport)}, any_pair},
    {{"candidate cells", stages::candidate_cells, kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs, R::kScreened, R::kOccupancy, R::kTrees), mask(R::kCandidates)}, any_pair},
    {{"contours",        stages::contours,        kShapes | mask(R::kPairs, R::kCandidates),                         mask(R::kContours)}, wants_contours},
    {{"overlap",         stages::overlap,         kShapes | mask(R::kBoxes, R::kPairs, R::kScreened, R::kCandidates, R::kTrees), mask(R::kNear, R::kContacts, R::kReport)}, any_pair},
    {{"edge pass",       stages::edge_pass,       kShapes | mask(R::kSettings, R::kPairs, R::kCandidates, R::kNear, R::kTrees, R::kBoxes, R::kContactMemory), mask(R::kContacts, R::kReport)}, any_pair},
    {{"face pass",       stages::face_pass,       kShapes | mask(R::kSettings, R::kPairs, R::kCandidates, R::kScreened, R::kNear, R::kTrees), mask(R::kContacts)}, wants_faces},
    {{"penetration",     stages::penetration,     mask(R::kPairs, R::kContacts),                                     mask(R::kPenetrations, R::kReport)}, any_pair},
    {{"deep overlap",    stages::deep_overlap,    kShapes | mask(R::kPairs, R::kContacts, R::kTrees),                 mask(R::kPairMemory, R::kPenetrations)}, wants_ways_out},
    {{"regions",         stages::regions,         kShapes | mask(R::kPairs, R::kScreened, R::kNear, R::kContacts, R::kContours), mask(R::kRegions)}, wants_regions},
    {{"contact rows",    stages::contact_rows,    kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs, R::kCandidates, R::kNear, R::kContacts, R::kPenetrations, R::kContactMemory, R::kLinks, R::kTools, R::kNodes), mask(R::kRows, R::kReport)}, any_pair},
    {{"islands",         stages::islands,         mask(R::kBodies, R::kRows, R::kLinks, R::kTools),                  mask(R::kIslands)}, any_mover},
    {{"local contact",   stages::local_contact,   kShapes | mask(R::kClock, R::kTools, R::kToolState, R::kNodes, R::kNodeState, R::kBoxes),     mask(R::kToolState, R::kLocalContact)}, any_tool},
};

constexpr FrameStage kAdvance[] = {
    {{"advance", stages::advance, mask(R::kSleep, R::kSettings, R::kMeshes, R::kSprings, R::kSolids, R::kBodies, R::kAnchors, R::kPaths, R::kTools, R::kClock, R::kIslands, R::kLocalContact, R::kTears, R::kNodes),
      mask(R::kPoses, R::kParticles, R::kRows, R::kContactMemory, R::kToolState, R::kLinks, R::kTorn, R::kTornSprings, R::kNodeState, R::kEnergy, R::kReport)}, any_mover},
};

constexpr FrameStage kEndStages[] = {
    {{"surface normals", stages::surface_normals, kShapes,                                                           mask(R::kNormals)}, any_deformable},
    {{"energy",          stages::energy,          mask(R::kSettings, R::kSprings, R::kSolids, R::kBodies, R::kPoses, R::kParticles, R::kAnchors, R::kLinks, R::kTears, R::kTornSprings, R::kNodes, R::kNodeState), mask(R::kEnergy)}, any_energy},
    {{"picture",         stages::picture,         kShapes | mask(R::kClock, R::kNormals, R::kContacts, R::kPenetrations, R::kTools, R::kToolState, R::kTears, R::kLives, R::kNodeState), mask(R::kPicture)}, any_body},
};
// clang-format on

constexpr std::string_view kFirstDetection = "body boxes", kAfterDetection = "local contact";

}  // namespace

std::span<const FrameStage> begin_stages() { return kBegin; }
std::span<const FrameStage> advance_stages() { return kAdvance; }

// The stages this scene wants, and the graphs over them: one for a pass, one for a picture.
struct Frame::Graphs {
    // What an observer needs to know of its list.
    struct List {
        Graphs* graphs = nullptr;
        uint32_t first = 0;
    };
    FrameState* state = nullptr;
    std::vector<Stage> stages;  // all, in serial order
    std::vector<std::string> names;
    std::vector<uint32_t> detection;
    uint32_t end_first = 0;
    std::vector<uint64_t> begin_ns;
    List pass_list, end_list;
    std::unique_ptr<JobGraph> pass, end;

    static void begin_stage(void* user, uint32_t row) {
        const List& list = *static_cast<List*>(user);
        list.graphs->begin_ns[list.first + row] = now_ns();
    }
    static void end_stage(void* user, uint32_t row) {
        const List& list = *static_cast<List*>(user);
        Graphs& g = *list.graphs;
        const uint32_t stage = list.first + row;
        const uint64_t duration = now_ns() - g.begin_ns[stage];
        g.state->times.stage_ns[stage] = duration;
        if (g.state->options.trace)
            g.state->options.trace->add(
                {g.stages[stage].name, g.begin_ns[stage], duration, thread_index(), static_cast<uint32_t>(g.state->world.clock.pass)});
    }
    void choose() {
        stages.clear(), names.clear(), detection.clear();
        add(kBegin);
        for (uint32_t s = 0; s < stages.size(); ++s) {
            const bool started = !detection.empty() || stages[s].name == kFirstDetection;
            if (started && stages[s].name != kAfterDetection) detection.push_back(s);
        }
        add(kAdvance);
        end_first = static_cast<uint32_t>(stages.size());
        add(kEndStages);
        begin_ns.assign(stages.size(), 0);
        state->times.stage_ns.assign(stages.size(), 0);
        pass_list = {this, 0};
        end_list = {this, end_first};
        const std::span<const Stage> all(stages);
        pass = std::make_unique<JobGraph>(all.first(end_first), *state, StageObserver{begin_stage, end_stage, &pass_list});
        end = std::make_unique<JobGraph>(all.subspan(end_first), *state, StageObserver{begin_stage, end_stage, &end_list});
    }
    void add(std::span<const FrameStage> list) {
        for (const FrameStage& row : list) {
            if (!row.wanted(state->world)) continue;
            if (!state->options.pictures && (row.stage.writes & mask(R::kNormals, R::kPicture))) continue;
            stages.push_back(row.stage);
            names.emplace_back(row.stage.name);
        }
    }
    void run(bool end_of_picture) {
        const std::span<const Stage> all(stages);
        List& list = end_of_picture ? end_list : pass_list;
        const StageObserver observer{begin_stage, end_stage, &list};
        if (state->options.serial) {
            run_serial(end_of_picture ? all.subspan(end_first) : all.first(end_first), *state, observer);
        } else {
            (end_of_picture ? end : pass)->run();
        }
    }
};

namespace {

// Energy of the bodies from row `first` on, J.
double energy_from(FrameState& f, size_t first) {
    const World& w = f.world;
    const EnergyInputs inputs = energy_inputs(f, other_forces(f));
    Energy sum;
    for (uint32_t body = static_cast<uint32_t>(first); body < w.bodies.mesh.size(); ++body)
        add_body_energy(inputs, body, f.scratch.energy.part[0], sum);
    return sum.kinetic + sum.elastic + sum.pressure + sum.bending + sum.gravity;
}

}  // namespace

Frame::Frame(World world, const FrameOptions& options) : state_(new FrameState), graphs_(new Graphs) {
    const FloatModeScope ours;
    state_->world = std::move(world);
    state_->options = options;
    graphs_->state = state_.get();
    take_in_bodies();
    warm_up();
}

// What a frame keeps about its bodies, for all or for those that have come since it last looked.
void Frame::take_in_bodies() {
    FrameState& f = *state_;
    World& w = f.world;
    const bool at_first = graphs_->pass == nullptr;
    const size_t before = f.bodies;
    if (!at_first && w.bodies.mesh.size() == before && w.meshes.info.size() == f.prototypes) return;
    if (w.bodies.mesh.size() < before) throw InputError("a body was taken out of a running frame: only those of a pool go");
    if (const std::string missing = find_unfinished(w); !missing.empty()) throw InputError("cannot be simulated: " + missing);
    f.bodies = w.bodies.mesh.size();
    f.prototypes = w.meshes.info.size();
    for (size_t body = before; f.options.trace && body < f.bodies; ++body)
        f.island_name.push_back(f.options.trace->keep("island of " + w.bodies.name[body]));
    graphs_->choose();
    if (any_tear(w)) copy_torn_springs(w.springs, w.solids, w.bodies, w.tears, w.torn, w.torn_springs);
    if (f.energy_open)
        f.energy_start += energy_from(f, before);
    else if (any_energy(w) && f.options.account_energy)
        stages::energy(f);  // opens the books
}

Frame::~Frame() = default;

namespace {

// Caches may change time, never results: tests forget them all.
void clear_caches(FrameState& f) {
    f.scratch = {};
    for (const auto& tree : f.world.trees) tree->rebuild();
}

void begin_pass(FrameState& f) {
    Clock& clock = f.world.clock;
    clock.period = static_cast<uint32_t>(pass_tick(clock.pass + 1, clock.contact_rate) - clock.tick);
    std::fill(f.times.stage_ns.begin(), f.times.stage_ns.end(), 0);
    f.times.picture = false;
    if (f.options.clear_caches) clear_caches(f);
    if (clock.pass != f.scratch.next_pass) std::fill(f.scratch.sleeps.begin(), f.scratch.sleeps.end(), 0);
    f.scratch.next_pass = clock.pass + 1;
}

// Moves the clock to the end of the pass; true when a picture is due there.
bool end_pass(FrameState& f) {
    Clock& clock = f.world.clock;
    clock.tick += clock.period;
    ++clock.pass;
    return clock.tick >= pass_tick(clock.picture + 1, clock.display_rate);
}

// Bodies at rest look as far ahead as moving ones, where they are few: what tools will touch. A lattice of a thousand at rest
// would see all its neighbours and hold several times the memory of any pass.
void reach_out(World& w) {
    constexpr size_t kFew = 64;
    if (w.boxes.box.size() > kFew) return;
    for (uint32_t body = 0; body < w.boxes.box.size(); ++body) {
        const double edge = w.meshes.info[w.bodies.mesh[body]].mean_edge;
        w.boxes.margin[body] += edge;
        w.boxes.box[body].min.array() -= edge;
        w.boxes.box[body].max.array() += edge;
    }
}

}  // namespace

// Finds contacts once before the clock starts, so that the first passes find their memory in place.
void Frame::warm_up() {
    const Report before = state_->world.report;
    const Sleep sleep_before = state_->world.sleep;
    begin_pass(*state_);
    state_->scratch.device.resize(state_->world.haptics.tool.size() * (state_->world.clock.period + 1));
    for (const uint32_t s : graphs_->detection) {
        run_stage(s);
        if (stages()[s].name == kFirstDetection) reach_out(state_->world);
    }
    state_->world.report = before;
    state_->world.sleep = sleep_before;
}

void Frame::step() {
    const FloatModeScope ours;
    take_in_bodies();
    begin_pass(*state_);
    graphs_->run(false);
    if (!end_pass(*state_)) return;
    graphs_->run(true);
    ++state_->world.clock.picture;
    state_->times.picture = true;
}

void Frame::step_until(uint32_t row) {
    const FloatModeScope ours;
    take_in_bodies();
    begin_pass(*state_);
    for (uint32_t s = 0; s < row; ++s) {
        run_stage(s);
        if (s + 1 == graphs_->end_first) end_pass(*state_);
    }
}

void Frame::set_contact_hook(const ContactHook& hook) { state_->contact_hook = hook; }

void Frame::set_live_devices(std::span<const DeviceState> devices) {
    std::copy_n(devices.begin(), std::min(devices.size(), kMaxTools), state_->scratch.live_device.begin());
    state_->scratch.live_device_known = !devices.empty();
}
std::span<const DeviceState> Frame::live_devices() const {
    const FrameScratch& s = state_->scratch;
    return std::span(s.live_device).first(s.live_device_known ? state_->world.haptics.tool.size() : 0);
}

void Frame::run_pass_again() { state_->scratch.next_pass = state_->world.clock.pass; }

const PictureSnapshot& Frame::snapshot_now() {
    const FloatModeScope ours;
    if (any_deformable(state_->world)) stages::surface_normals(*state_);
    stages::picture(*state_);
    return state_->world.picture;
}

void Frame::run_stage(uint32_t row) {
    const FloatModeScope ours;
    graphs_->stages[row].run(*state_);
}
std::span<const Stage> Frame::stages() const { return graphs_->stages; }
World& Frame::world() { return state_->world; }
const World& Frame::world() const { return state_->world; }
const std::vector<std::string>& Frame::stage_names() const { return graphs_->names; }
const FrameTimes& Frame::times() const { return state_->times; }
std::span<const uint32_t> Frame::detection_stages() const { return graphs_->detection; }

void detect_contacts(World& world, bool show_cells) {
    const FloatModeScope ours;
    if (const std::string missing = find_unfinished(world); !missing.empty()) throw InputError("cannot be simulated: " + missing);
    FrameState state;
    state.face_queries = 100'000;  // an answer, not a frame
    if (show_cells) state.direct_tests = 0;
    std::swap(state.world, world);
    for (const HandTool& tool : state.world.haptics.tool) {  // hands stay where they are
        DeviceState held;
        held.orientation = state.world.poses.orientation[tool.body];
        held.position = state.world.poses.origin[tool.body] + rotate(held.orientation, tool.tip);
        state.scratch.device.insert(state.scratch.device.end(), state.world.clock.period + 1, held);
    }
    const auto first =
        std::find_if(std::begin(kBegin), std::end(kBegin), [](const FrameStage& row) { return row.stage.name == kFirstDetection; });
    for (auto row = first; row->stage.name != kAfterDetection; ++row)
        if (row->wanted(state.world)) row->stage.run(state);
    std::swap(state.world, world);
}

}  // namespace trocar
