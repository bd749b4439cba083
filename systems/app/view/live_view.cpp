#include "systems/app/view/live_view.hpp"

#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>
#include <utility>

#include "engine/base/error.hpp"
#include "engine/jobs/real_time.hpp"
#include "systems/app/console/stop_signal.hpp"
#include "systems/app/player/player_page.hpp"
namespace trocar {
namespace {

using nlohmann::json;

constexpr int64_t kPicture = 1'000'000'000 / 30 - 2'000'000;  // ns between two shown frames, less than what passes may be early
constexpr int64_t kRateTime = 500'000'000;                    // ns over which the rate is measured
constexpr int64_t kMostBehind = 200'000'000;                  // ns: beyond it lost time is not caught up
constexpr double kSlowest = 1e-3, kFastest = 100;             // speeds that can be asked for
constexpr auto kPause = std::chrono::milliseconds(5);         // between looks at the buttons

// The script starts the view when it finds this element. The page has no script of its own: its security policy allows none.
constexpr const char* kPage = R"(<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Trocar</title><link rel="icon" href="data:,">
<style>body{margin:0;font:15px/1.45 system-ui,sans-serif;color:#111827;background:#f4f6f8}
#player{margin:10px;min-height:300px}#player p{padding:12px}h1{font-size:16px;margin:10px 12px 0}table{border-collapse:collapse}
#player canvas,#player .facts3d{height:calc(100vh - 235px)!important;max-height:none!important}</style>
</head><body><h1>Trocar</h1><div id="player" data-live><p>Connecting. The view needs JavaScript.</p></div>
<script src="player.js" defer></script></body></html>
)";

ViewFiles files_of_view() {
    if (!has_player())
        throw InputError(
            "--view: this program was built without the player: Node.js and npm, or the packages they load, were not there then");
    return {kPage, packed_player_script()};
}

std::optional<double> number_in(const json& object, const char* key) {
    const auto found = object.find(key);
    if (found == object.end() || !found->is_number()) return std::nullopt;
    return found->get<double>();
}

// A target of {"body": .., "tip": [x, y, z], "grip": .., "buttons": ..}.
std::optional<BrowserHandTarget> target_of(const json& object) {
    const auto tip = object.find("tip");
    if (tip == object.end() || !tip->is_array() || tip->size() != 3) return std::nullopt;
    BrowserHandTarget target;
    for (size_t k = 0; k < 3; ++k) {
        if (!(*tip)[k].is_number()) return std::nullopt;
        target.tip[static_cast<int>(k)] = (*tip)[k].get<double>();
    }
    target.grip = std::clamp(number_in(object, "grip").value_or(0), 0.0, 1.5);
    target.buttons = static_cast<uint32_t>(std::clamp(number_in(object, "buttons").value_or(0), 0.0, 65535.0));
    return target;
}

}  // namespace

LiveView::LiveView(uint16_t port)
    : server_(port, files_of_view(),
              {[this](uint32_t client, const std::string& text) { obey(client, text); }, [this](uint32_t client) { left(client); }}) {}

LiveView::~LiveView() = default;

void LiveView::obey(uint32_t client, const std::string& text) {
    const json message = json::parse(text, nullptr, false);
    const auto word = message.is_object() ? message.find("do") : message.end();
    if (!message.is_object() || word == message.end() || !word->is_string()) return;
    const std::string& what = word->get_ref<const std::string&>();
    uint32_t nobody = 0;
    if (what == "hold") holder_.compare_exchange_strong(nobody, client);
    if (holder_ != client) return;
    if (what == "pause") paused_ = true;
    if (what == "play") paused_ = false;
    if (what == "step") paused_ = true, steps_ += 1;
    if (what == "reset") reset_ = true;
    if (what == "end") ended_ = true;
    if (what == "capture") capture_ = captures_.load();
    if (what == "set" || what == "grab" || what == "pull" || what == "let" || what == "bleed" || what == "slip") add_command(text);
    if (what == "speed") {
        const double speed = number_in(message, "value").value_or(1);
        if (speed >= kSlowest && speed <= kFastest) speed_ = speed;
    }
    if (what == "hand") {
        const std::optional<double> body = number_in(message, "body");
        std::optional<BrowserHandTarget> target = target_of(message);
        const std::lock_guard guard(hands_lock_);
        const auto hand = body && *body >= 0 && *body < kNone ? hands_.find(static_cast<uint32_t>(*body)) : hands_.end();
        if (target && hand != hands_.end()) hand->second->aim(*target);
    }
}

void LiveView::add_command(const std::string& text) {
    ViewCommand command;
    try {
        command = read_view_command(text);
    } catch (const InputError& error) {
        return tell(error.what());
    }
    const std::lock_guard guard(commands_lock_);
    const bool pulls = command.kind == ViewCommand::Kind::kPull;
    if (pulls && !commands_.empty() && commands_.back().kind == ViewCommand::Kind::kPull)
        commands_.back() = command;
    else if (commands_.size() < kMostCommands)
        commands_.push_back(command);
    else if (command.kind == ViewCommand::Kind::kLet)
        commands_.back() = command;  // must not be lost
    if (command.kind == ViewCommand::Kind::kGrab) grabs_ = true;
}

std::vector<ViewCommand> LiveView::take_commands() {
    const std::lock_guard guard(commands_lock_);
    return std::exchange(commands_, {});
}

void LiveView::tell(const std::string& text) {
    const std::lock_guard guard(commands_lock_);
    told_ = text;
}

void LiveView::left(uint32_t client) {
    // nobody is there any more to let go of what it held
    if (holder_ == client && grabs_.exchange(false)) add_command(R"({"do":"let"})");
    uint32_t holder = client;
    holder_.compare_exchange_strong(holder, 0);
}

void LiveView::attach(const Frame& frame, const std::string& scene, const Camera& camera, bool paced) {
    coder_.emplace(frame);
    scene_ = scene, camera_ = camera, paced_ = paced;
    shown_ = false, shown_ns_ = 0;
    steps_ = 0;
    {
        const std::lock_guard guard(hands_lock_);
        hands_.clear();
    }
    {
        const std::lock_guard guard(commands_lock_);
        commands_.clear(), told_.clear();
    }
    capture_ = grabs_ = false;
    stage_ns_.assign(frame.stage_names().size(), 0);
    server_.restart();
    start_clock(frame);
}

std::unique_ptr<DeviceLink> LiveView::open_device(uint32_t body, const HandTool& tool, const DeviceState& start) {
    auto hand = std::make_shared<BrowserHand>(tool, start);
    const std::lock_guard guard(hands_lock_);
    hands_[body] = hand;
    return open_browser_device(hand);
}

std::string LiveView::status(uint32_t client) const {
    json text{{"paused", paused_.load()}, {"speed", speed_.load()}, {"rate", rate_}, {"time", time_}, {"paced", paced_}};
    text["holds"] = holder_ == client, text["held"] = holder_ != 0, text["clients"] = server_.clients();
    text["captures"] = captures_.load();
    {
        const std::lock_guard guard(commands_lock_);
        text["told"] = told_;
    }
    text["hands"] = json::array();
    for (const auto& [body, hand] : hands_) text["hands"].push_back(body);
    return text.dump(-1, ' ', false, json::error_handler_t::replace);
}

void LiveView::show(const Frame& frame) {
    if (!server_.begin()) return;
    PlayerFrame next = coder_->next(frame, stage_ns_);
    server_.send_frame(std::move(next), coder_->coordinates());
    if (server_.has_newcomers()) {
        std::vector<uint8_t> bytes = coder_->start(scene_, camera_, 1);
        const PlayerFrame whole = coder_->whole(frame.world());
        put_frames(bytes, std::span(&whole, 1));
        server_.send_start(std::move(bytes));
    }
    const int64_t now = monotonic_ns();
    if (now - rate_ns_ > kRateTime) {
        rate_ = 1e6 * static_cast<double>(frame.world().clock.tick - rate_tick_) / static_cast<double>(now - rate_ns_);
        rate_ns_ = now, rate_tick_ = frame.world().clock.tick;
    }
    time_ = 1e-3 * static_cast<double>(frame.world().clock.tick);
    server_.send_status([this](uint32_t client) { return status(client); });
    server_.end();
    shown_ = true, shown_ns_ = now;
}

void LiveView::after_pass(const Frame& frame, std::span<const uint64_t> stage_ns) {
    stage_ns_.assign(stage_ns.begin(), stage_ns.end());
    shown_ = false;
    if (monotonic_ns() - shown_ns_ >= kPicture) show(frame);
}

bool LiveView::goes_on() const { return !ended_ && !reset_ && stop_signal() == 0; }

void LiveView::start_clock(const Frame& frame) {
    clock_ns_ = monotonic_ns(), clock_tick_ = frame.world().clock.tick, clock_speed_ = speed_;
    rate_ns_ = clock_ns_, rate_tick_ = clock_tick_;
}

LiveView::Turn LiveView::wait(const Frame& frame) {
    bool waited = false, steps = false;
    while (goes_on() && paused_) {
        steps = steps_ > 0;
        if (steps) {
            --steps_;
            break;
        }
        // what the last pass did, and to who has come since, the state they have missed; ten times a second, for the buttons' sake
        if (!shown_ || monotonic_ns() - shown_ns_ > 3 * kPicture) show(frame);
        waited = true;
        std::this_thread::sleep_for(kPause);
    }
    if (waited) start_clock(frame);
    return !goes_on() ? Turn::kEnd : steps ? Turn::kStep : Turn::kGo;
}

bool LiveView::wait_while_paused(const Frame& frame) { return wait(frame) != Turn::kEnd; }

bool LiveView::wait_for_turn(const Frame& frame) {
    const auto due = [&] {
        return clock_ns_ + static_cast<int64_t>(1e6 * static_cast<double>(frame.world().clock.tick - clock_tick_) / clock_speed_);
    };
    for (;;) {
        const Turn turn = wait(frame);
        if (turn != Turn::kGo) return turn == Turn::kStep;
        if (speed_ != clock_speed_ || monotonic_ns() - due() > kMostBehind) start_clock(frame);
        // in slices: at a hundredth of the speed a pass is a second away
        while (goes_on() && !paused_ && speed_ == clock_speed_ && monotonic_ns() < due())
            sleep_until_ns(std::min(due(), monotonic_ns() + 20'000'000));
        if (!paused_ && monotonic_ns() >= due()) return goes_on();
    }
}

}  // namespace trocar
