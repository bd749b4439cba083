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
bool any_jaw_or_link(const World& w) { return any_pair(w) && (any_link(w) || !w.haptics.jaw.empty()); }
bool any_excluded(const World& w) { return any_pair(w) && (any_tool(w) || !w.nodes.apart.empty()); }
bool any_fast(const World& w) { return any_pair(w) && (any_tool(w) || !w.bodies.rigid_mass.empty()); }
bool any_free_pair(const World& w) { return any_pair(w) && !w.bodies.rigid_mass.empty(); }
bool any_drive(const World& w) { return any_tool(w) && !w.nodes.drive.empty(); }
bool anyone_sleeps(const World& w) { return any_energy(w) && w.settings.sleep_speed > 0; }

using R = Resource;
using S = StageId;
using P = FramePart;
constexpr ResourceMask kShapes = mask(R::kMeshes, R::kBodies, R::kPoses, R::kParticles);

// clang-format off
constexpr FrameStage kStages[] = {
    // id                   part           name               run                       reads, writes                                                                                wanted
    {S::kDeviceInput,     P::kInput,    {"device input",    stages::device_input,      mask(R::kClock, R::kPaths, R::kTools),
        mask(R::kToolState, R::kDevices, R::kLiveDevices)}, any_tool},
    {S::kNodes,           P::kInput,    {"nodes",           stages::nodes,             mask(R::kClock, R::kNodes, R::kTools, R::kLives),
        mask(R::kPoses, R::kToolState, R::kNodeState, R::kSleep)}, any_switch},
    {S::kRigidMotion,     P::kInput,    {"rigid motion",    stages::rigid_motion,      mask(R::kClock, R::kPaths, R::kNodeState),
        mask(R::kPoses)}, any_path},
    {S::kComeAndGo,       P::kInput,    {"come and go",     stages::bodies_come_and_go,kShapes | mask(R::kSettings, R::kSprings, R::kSolids, R::kAnchors, R::kPools, R::kClock),
        mask(R::kPoses, R::kParticles, R::kSleep, R::kLives, R::kEnergy)}, any_pool},
    {S::kLinks,           P::kInput,    {"links",           stages::link,              kShapes | mask(R::kSolids, R::kClock, R::kTrees, R::kToolState),
        mask(R::kLinks, R::kSleep, R::kEnergy, R::kReport)}, any_link},
    {S::kTears,           P::kInput,    {"tears",           stages::tear,              mask(R::kSettings, R::kClock, R::kSprings, R::kSolids, R::kBodies, R::kPoses, R::kAnchors),
        mask(R::kParticles, R::kMeshes, R::kTrees, R::kTears, R::kTorn, R::kTornSprings, R::kSleep, R::kEnergy, R::kReport)}, any_tear},
    {S::kTornSprings,     P::kInput,    {"torn springs",    stages::torn_springs,      mask(R::kSprings, R::kSolids, R::kBodies, R::kTears, R::kTorn),
        mask(R::kTornSprings)}, any_tear},
    {S::kBodyBoxes,       P::kDetection,{"body boxes",      stages::body_boxes,        kShapes | mask(R::kSettings, R::kClock, R::kTools, R::kDevices, R::kLives, R::kNodeState, R::kSleep),
        mask(R::kBoxes)}, any_pair},
    {S::kFastBodies,      P::kDetection,{"fast bodies",     stages::fast_bodies,       kShapes | mask(R::kSettings, R::kClock, R::kTools, R::kDevices, R::kNodeState),
        mask(R::kBoxes, R::kFastBodies)}, any_fast},
    {S::kJoinedBodies,    P::kDetection,{"joined bodies",   stages::joined_bodies,     mask(R::kBodies, R::kLinks, R::kTools),
        mask(R::kJoinedBodies)}, any_jaw_or_link},
    {S::kExcludedPairs,   P::kDetection,{"excluded pairs",  stages::excluded_pairs,    mask(R::kBoxes, R::kNodes, R::kTools),
        mask(R::kToolState, R::kExcludedPairs)}, any_excluded},
    {S::kBoxPairs,        P::kDetection,{"box pairs",       stages::box_pairs,         mask(R::kBodies, R::kBoxes, R::kExcludedPairs),
        mask(R::kBoxPairs)}, any_pair},
    {S::kCandidatePairs,  P::kDetection,{"candidate pairs", stages::candidate_pairs,   kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kBoxPairs),
        mask(R::kPairs, R::kDisplacementBounds)}, any_pair},
    {S::kSleep,           P::kDetection,{"sleep",           stages::sleep,             mask(R::kSettings, R::kBodies, R::kPaths, R::kClock, R::kJoinedBodies, R::kNodes, R::kLives),
        mask(R::kSleep, R::kParticles, R::kPoses, R::kPairs, R::kEnergy, R::kReport)}, anyone_sleeps},
    {S::kRefitTrees,      P::kDetection,{"refit trees",     stages::refit,             kShapes | mask(R::kPairs),
        mask(R::kTrees)}, any_pair},
    {S::kImpactTimes,     P::kDetection,{"impact times",    stages::impact_times,      kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs, R::kTrees, R::kFastBodies),
        mask(R::kImpactTimes)}, any_fast},
    {S::kRasterise,       P::kDetection,{"rasterise",       stages::rasterise_bodies,  kShapes | mask(R::kSettings, R::kBoxes, R::kPairs),
        mask(R::kScreened, R::kOccupancy, R::kReport)}, any_pair},
    {S::kCandidateCells,  P::kDetection,{"candidate cells", stages::candidate_cells,   kShapes | mask(R::kSettings, R::kClock, R::kBoxes, R::kPairs, R::kDisplacementBounds, R::kScreened, R::kOccupancy, R::kTrees),
        mask(R::kCandidates)}, any_pair},
    {S::kPartedTriangles, P::kDetection,{"parted triangles",stages::parted_triangles,  kShapes | mask(R::kSettings, R::kBoxes, R::kPairs),
        mask(R::kCandidates)}, any_pair},
    {S::kContours,        P::kDetection,{"contours",        stages::contours,          kShapes | mask(R::kPairs, R::kCandidates),
        mask(R::kContours)}, wants_contours},
    {S::kOverlap,         P::kDetection,{"overlap",         stages::overlap,           kShapes | mask(R::kBoxes, R::kPairs, R::kScreened, R::kCandidates, R::kTrees),
        mask(R::kNear, R::kContacts, R::kReport)}, any_pair},
    {S::kEdgePass,        P::kDetection,{"edge pass",       stages::edge_pass,         kShapes | mask(R::kSettings, R::kPairs, R::kCandidates, R::kNear, R::kTrees, R::kBoxes),
        mask(R::kContacts, R::kReport)}, any_pair},
    {S::kMemoryOrder,     P::kDetection,{"memory order",    stages::memory_order,      mask(R::kContactMemory),
        mask(R::kMemoryOrder)}, any_pair},
    {S::kKeptEdges,       P::kDetection,{"kept edges",      stages::kept_edges,        kShapes | mask(R::kSettings, R::kPairs, R::kTrees, R::kBoxes, R::kContactMemory, R::kMemoryOrder),
        mask(R::kContacts)}, any_pair},
    {S::kFacePass,        P::kDetection,{"face pass",       stages::face_pass,         kShapes | mask(R::kSettings, R::kPairs, R::kCandidates, R::kScreened, R::kNear, R::kTrees),
        mask(R::kContacts)}, wants_faces},
    {S::kPenetration,     P::kDetection,{"penetration",     stages::penetration,       mask(R::kPairs, R::kContacts),
        mask(R::kPenetrations, R::kReport)}, any_pair},
    {S::kDeepOverlap,     P::kDetection,{"deep overlap",    stages::deep_overlap,      kShapes | mask(R::kPairs, R::kContacts, R::kTrees),
        mask(R::kPairMemory, R::kPenetrations)}, wants_ways_out},
    {S::kRegions,         P::kDetection,{"regions",         stages::regions,           kShapes | mask(R::kPairs, R::kScreened, R::kNear, R::kContacts, R::kContours),
        mask(R::kRegions)}, wants_regions},
    {S::kContactRows,     P::kDetection,{"contact rows",    stages::contact_rows,      kShapes | mask(R::kSettings, R::kBoxes, R::kPairs, R::kContacts, R::kPenetrations),
        mask(R::kRows, R::kReport)}, any_pair},
    {S::kEdgeRows,        P::kDetection,{"edge rows",       stages::edge_rows,         kShapes | mask(R::kSettings, R::kBoxes, R::kPairs, R::kCandidates),
        mask(R::kRows)}, any_free_pair},
    {S::kLoadedRows,      P::kDetection,{"loaded rows",     stages::loaded_rows,       kShapes | mask(R::kContactMemory, R::kMemoryOrder, R::kRows),
        mask(R::kLoadedRows)}, any_pair},
    {S::kIdleRows,        P::kDetection,{"idle rows",       stages::idle_rows,         kShapes | mask(R::kSettings, R::kClock, R::kDisplacementBounds, R::kLoadedRows, R::kJoinedBodies, R::kNodes),
        mask(R::kRows)}, any_pair},
    {S::kImpliedRows,     P::kDetection,{"implied rows",    stages::implied_rows,      kShapes,
        mask(R::kRows)}, any_pair},
    {S::kWarmStart,       P::kDetection,{"warm start",      stages::warm_start,        mask(R::kContactMemory, R::kMemoryOrder),
        mask(R::kRows)}, any_pair},
    {S::kIslands,         P::kDetection,{"islands",         stages::islands,           mask(R::kBodies, R::kRows, R::kJoinedBodies),
        mask(R::kIslands)}, any_mover},
    {S::kLocalContact,    P::kHaptics,  {"local contact",   stages::local_contact,     kShapes | mask(R::kClock, R::kTools, R::kToolState, R::kNodeState, R::kBoxes),
        mask(R::kLocalContact)}, any_tool},
    {S::kHapticSurfaces,  P::kHaptics,  {"haptic surfaces", stages::haptic_surfaces,   mask(R::kTools, R::kPoses),
        mask(R::kLocalContact)}, any_tool},
    {S::kDriveYield,      P::kHaptics,  {"drive yield",     stages::drive_yield,       mask(R::kTools, R::kToolState, R::kBodies, R::kNodes, R::kNodeState),
        mask(R::kLocalContact)}, any_drive},
    {S::kTissueGive,      P::kHaptics,  {"tissue give",     stages::tissue_give,       kShapes | mask(R::kTools),
        mask(R::kToolState, R::kLocalContact)}, any_tool},
    {S::kContactHook,     P::kHaptics,  {"contact hook",    stages::contact_hook,      kShapes | mask(R::kClock, R::kTools),
        mask(R::kToolState, R::kLocalContact)}, any_tool},
    {S::kHoldingGroups,   P::kAdvance,  {"holding groups",  stages::holding_groups,    mask(R::kBodies, R::kLinks),
        mask(R::kHoldingGroups)}, any_link},
    {S::kAdvance,         P::kAdvance,  {"advance",         stages::advance,           mask(R::kSleep, R::kSettings, R::kMeshes, R::kSprings, R::kSolids, R::kBodies, R::kAnchors, R::kPaths, R::kTools, R::kClock, R::kIslands, R::kLocalContact, R::kTears, R::kNodes, R::kImpactTimes, R::kHoldingGroups),
        mask(R::kPoses, R::kParticles, R::kRows, R::kToolState, R::kDevices, R::kLinks, R::kTorn, R::kTornSprings, R::kNodeState, R::kEnergy, R::kReport)}, any_mover},
    {S::kContactMemory,   P::kAdvance,  {"contact memory",  stages::contact_memory,    mask(R::kRows),
        mask(R::kContactMemory)}, any_mover},
    {S::kLinkForces,      P::kAdvance,  {"link forces",     stages::link_forces,       mask(R::kClock, R::kTools),
        mask(R::kLinks, R::kToolState)}, any_link},
    {S::kHandForces,      P::kAdvance,  {"hand forces",     stages::hand_forces,       mask(R::kClock, R::kTools),
        mask(R::kToolState)}, any_tool},
    {S::kSurfaceNormals,  P::kPicture,  {"surface normals", stages::surface_normals,   kShapes,
        mask(R::kNormals)}, any_deformable},
    {S::kEnergy,          P::kPicture,  {"energy",          stages::energy,            mask(R::kSettings, R::kSprings, R::kSolids, R::kBodies, R::kPoses, R::kParticles, R::kAnchors, R::kLinks, R::kTears, R::kTorn, R::kTornSprings, R::kNodes, R::kNodeState),
        mask(R::kEnergy, R::kEnergyStart)}, any_energy},
    {S::kPicture,         P::kPicture,  {"picture",         stages::picture,           kShapes | mask(R::kClock, R::kNormals, R::kContacts, R::kPenetrations, R::kTools, R::kToolState, R::kTears, R::kLives, R::kNodeState),
        mask(R::kPicture)}, any_body},
};
// clang-format on

constexpr bool is_in_order(std::span<const FrameStage> stages) {
    for (size_t row = 0; row < stages.size(); ++row)
        if (stages[row].id != static_cast<StageId>(row) || (row > 0 && stages[row].part < stages[row - 1].part)) return false;
    return stages.size() == static_cast<size_t>(StageId::kCount);
}
static_assert(is_in_order(kStages));

}  // namespace

std::span<const FrameStage> frame_stages() { return kStages; }

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
    std::array<uint32_t, static_cast<size_t>(StageId::kCount)> row{};  // of stages, per id; kNone = not wanted
    std::vector<uint32_t> detection;
    uint32_t end_first = 0;
    std::vector<uint64_t> begin_ns;
    List pass_list, end_list;
    std::unique_ptr<JobGraph> pass, end;

    static void begin_stage(void* user, uint32_t row) {
        const List& list = *static_cast<List*>(user);
        Graphs& g = *list.graphs;
        if (g.state->options.clear_scratch) g.state->scratch = {};
        g.begin_ns[list.first + row] = now_ns();
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
        row.fill(kNone);
        for (const FrameStage& s : kStages)
            if (is_wanted(s)) add(s);
        end_first = first_of_picture();
        begin_ns.assign(stages.size(), 0);
        state->times.stage_ns.assign(stages.size(), 0);
        pass_list = {this, 0};
        end_list = {this, end_first};
        const std::span<const Stage> all(stages);
        pass = std::make_unique<JobGraph>(all.first(end_first), *state, StageObserver{begin_stage, end_stage, &pass_list});
        end = std::make_unique<JobGraph>(all.subspan(end_first), *state, StageObserver{begin_stage, end_stage, &end_list});
    }
    bool is_wanted(const FrameStage& s) const {
        if (!state->options.pictures && (s.stage.writes & mask(R::kNormals, R::kPicture))) return false;
        return s.wanted(state->world);
    }
    void add(const FrameStage& s) {
        const auto at = static_cast<uint32_t>(stages.size());
        row[static_cast<size_t>(s.id)] = at;
        if (s.part == P::kDetection) detection.push_back(at);
        stages.push_back(s.stage);
        names.emplace_back(s.stage.name);
    }
    // Row of the first stage of a picture, or the end.
    uint32_t first_of_picture() const {
        const auto picture = std::ranges::find(kStages, P::kPicture, &FrameStage::part) - kStages;
        const uint32_t first = *std::min_element(row.begin() + picture, row.end());
        return std::min(first, static_cast<uint32_t>(stages.size()));  // kNone is the largest
    }
    void run(bool end_of_picture) {
        const std::span<const Stage> all(stages);
        List& list = end_of_picture ? end_list : pass_list;
        const StageObserver observer{begin_stage, end_stage, &list};
        if (state->options.serial || state->options.clear_scratch) {
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
    const EnergyInputs inputs = energy_inputs(f.world);
    Energy sum;
    for (uint32_t body = static_cast<uint32_t>(first); body < w.bodies.mesh.size(); ++body)
        add_body_energy(inputs, body, f.scratch.energy.part[0], sum);
    return sum.kinetic + sum.elastic + sum.pressure + sum.bending + sum.gravity;
}

}  // namespace

Frame::Frame(World world, const FrameOptions& options) : state_(new FrameState), graphs_(new Graphs) {
    const FloatModeScope ours;
    state_->world = std::move(world);
    state_->world.live_devices.clear();
    state_->world.energy_start = {};
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
    if (w.energy_start.known)
        w.energy_start.sum += energy_from(f, before);
    else if (any_energy(w) && f.options.account_energy)
        stages::energy(f);  // opens the accounts
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
    SleeperCache& sleepers = f.scratch.sleepers;
    if (clock.pass != sleepers.next_pass) std::fill(sleepers.number.begin(), sleepers.number.end(), 0);
    sleepers.next_pass = clock.pass + 1;
}

// Moves the clock to the end of the pass; true when a picture is due there.
bool end_pass(FrameState& f) {
    Clock& clock = f.world.clock;
    clock.tick += clock.period;
    ++clock.pass;
    return clock.tick >= pass_tick(clock.picture + 1, clock.display_rate);
}

// Bodies at rest look as far ahead as moving ones: what tools will touch. See FrameLimits.
void reach_out(World& w) {
    for (uint32_t body = 0; body < w.boxes.box.size(); ++body) {
        const double edge = w.meshes.info[w.bodies.mesh[body]].mean_edge;
        w.boxes.margin[body] += edge;
        w.boxes.box[body].min.array() -= edge;
        w.boxes.box[body].max.array() += edge;
    }
}

// Devices that stay where they are told.
void hold_devices(const Clock& clock, std::span<const DeviceState> held, DeviceSamples& devices) {
    devices.per_tool = clock.period + 1;
    devices.placed.clear();
    for (const DeviceState& device : held) devices.placed.insert(devices.placed.end(), devices.per_tool, device);
}

}  // namespace

// Finds contacts once before the clock starts, so that the first passes find their memory in place.
void Frame::warm_up() {
    const Report before = state_->world.report;
    const Sleep sleep_before = state_->world.sleep;
    begin_pass(*state_);
    World& w = state_->world;
    hold_devices(w.clock, std::vector<DeviceState>(w.haptics.tool.size()), w.devices);
    for (const uint32_t s : graphs_->detection) {
        run_stage(s);
        const bool boxed = s == row_of(StageId::kFastBodies) || (s == row_of(StageId::kBodyBoxes) && row_of(StageId::kFastBodies) == kNone);
        if (boxed && w.boxes.box.size() <= state_->limits.most_warmed_bodies) reach_out(w);
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

void Frame::run_pass_again() { state_->scratch.sleepers.next_pass = state_->world.clock.pass; }

const PictureSnapshot& Frame::snapshot_now() {
    const FloatModeScope ours;
    if (any_deformable(state_->world)) stages::surface_normals(*state_);
    stages::picture(*state_);
    return state_->world.picture;
}

void Frame::run_stage(uint32_t row) {
    const FloatModeScope ours;
    if (state_->options.clear_scratch) state_->scratch = {};
    graphs_->stages[row].run(*state_);
}
std::span<const Stage> Frame::stages() const { return graphs_->stages; }
uint32_t Frame::row_of(StageId id) const { return graphs_->row[static_cast<size_t>(id)]; }
World& Frame::world() { return state_->world; }
const World& Frame::world() const { return state_->world; }
const std::vector<std::string>& Frame::stage_names() const { return graphs_->names; }
const FrameTimes& Frame::times() const { return state_->times; }
std::span<const uint32_t> Frame::detection_stages() const { return graphs_->detection; }

void detect_contacts(World& world, bool show_cells) {
    const FloatModeScope ours;
    if (const std::string missing = find_unfinished(world); !missing.empty()) throw InputError("cannot be simulated: " + missing);
    FrameState state;
    state.limits.face_queries = 100'000;  // an answer, not a frame
    if (show_cells) state.limits.direct_tests = 0;
    std::swap(state.world, world);
    World& w = state.world;
    std::vector<DeviceState> held(w.haptics.tool.size());  // hands stay where they are
    for (size_t t = 0; t < held.size(); ++t) {
        const HandTool& tool = w.haptics.tool[t];
        held[t].orientation = w.poses.orientation[tool.body];
        held[t].position = w.poses.origin[tool.body] + rotate(held[t].orientation, tool.tip);
    }
    hold_devices(w.clock, held, w.devices);
    for (const FrameStage& s : kStages)
        if (s.part == P::kDetection && s.wanted(w)) s.stage.run(state);
    std::swap(state.world, world);
}

}  // namespace trocar
