#include "engine/devices/link.hpp"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <numbers>

#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/devices/backends.hpp"
#include "engine/devices/device.hpp"
#include "engine/devices/simulated_hand.hpp"
#include "engine/files/text_file.hpp"
#include "engine/jobs/real_time.hpp"
#include "engine/jobs/thread_pool.hpp"
namespace trocar {
namespace {

constexpr int64_t kMillisecond = 1'000'000;  // ns
constexpr int kLinkNice = -15;               // above the simulation's priority where permitted: a late sample is an outdated hand position

// Calls once per millisecond until the link stops.
void every_millisecond(DeviceChannel& link, const std::function<void(double time, int64_t now)>& work) {
    const int64_t start = monotonic_ns();
    for (int64_t tick = 0; !link.stopping(); ++tick) {
        sleep_until_ns(start + tick * kMillisecond);
        work(static_cast<double>(tick) * 1e-3, monotonic_ns());
    }
}

// A hand that moves on circles of 30 mm, one in four seconds, and yields to forces as an arm does.
std::unique_ptr<DeviceLink> open_hand() {
    return std::make_unique<DeviceLink>("simulated hand", [](DeviceChannel& link) {
        HandModel hand;
        hand.mass = 0.3, hand.damping = 0.5, hand.stiffness = 200, hand.arm_damping = 8;
        HandModelState state;
        every_millisecond(link, [&](double time, int64_t now) {
            const double rate = 0.5 * std::numbers::pi, angle = rate * time;
            DeviceState intended;
            intended.time = time;
            intended.position = 0.03 * Vec3d(std::cos(angle), std::sin(angle), 0);
            intended.velocity = 0.03 * rate * Vec3d(-std::sin(angle), std::cos(angle), 0);
            bool fresh = false;
            const DeviceCommand command = link.command(now, fresh);
            if (fresh) link.count(DeviceCount::kSent);
            step_hand(hand, intended, command.force, 1e-3, state);
            link.count(DeviceCount::kReceived);
            link.publish(hand_device_state(hand, intended, state), now);
        });
    });
}

std::unique_ptr<DeviceLink> open_trace(const std::string& file) {
    DeviceTrace trace = read_device_trace(file);
    return std::make_unique<DeviceLink>("recording " + file, [trace = std::move(trace)](DeviceChannel& link) {
        const double begin = trace.sample.front().time;
        size_t next = 0;
        every_millisecond(link, [&](double time, int64_t now) {
            const size_t before = next;
            while (next < trace.sample.size() && trace.sample[next].time - begin <= time) ++next;
            if (next == before) return;
            link.count(DeviceCount::kReceived, next - before);
            link.publish(trace.sample[next - 1], now);
        });
    });
}

NetworkAddress parse_address(const std::string& specification, const std::string& rest, NetworkAddress address) {
    const size_t colon = rest.rfind(':');
    const std::string port = colon == std::string::npos ? rest : rest.substr(colon + 1);
    if (colon != std::string::npos) {
        address.host = rest.substr(0, colon);
        if (address.host.empty()) refuse_device(specification, "the address before \":\" is empty");
    }
    if (port.empty()) return address;
    const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), address.port);
    if (error != std::errc() || end != port.data() + port.size() || address.port == 0)
        refuse_device(specification, "\"" + port + "\" is no port (1 to 65535)");
    return address;
}

}  // namespace

const char* describe(DeviceCount count) {
    constexpr const char* kNames[] = {"received", "accepted", "malformed", "oversized", "out_of_order",
                                      "stranger", "lost",     "overrun",   "sent",      "reconnected"};
    static_assert(std::size(kNames) == static_cast<size_t>(DeviceCount::kCount));
    return kNames[static_cast<size_t>(count)];
}

DeviceLink::DeviceLink(const std::string& name, Loop loop) : channel_(std::make_shared<DeviceChannel>(one_line(name))) {
    std::promise<void> ended;
    ended_ = ended.get_future();
    thread_ = std::thread([channel = channel_, loop = std::move(loop), ended = std::move(ended)]() mutable {
        set_float_mode();
        set_nice(kLinkNice);
        loop(*channel);
        loop = nullptr;  // closes the device
        ended.set_value();
    });
}

DeviceLink::~DeviceLink() { close(); }

bool DeviceLink::close(double most) {
    DeviceLink* const self = this;
    return close_all({&self, 1}, most);
}

bool DeviceLink::close_all(std::span<DeviceLink* const> links, double most) {
    bool any = false;
    for (DeviceLink* link : links) {
        if (!link->running()) continue;
        link->let_go();
        any = true;
    }
    if (any) sleep_until_ns(monotonic_ns() + DeviceChannel::kSilence);  // devices notice: their threads check every millisecond
    for (DeviceLink* link : links) link->channel_->stop();
    const int64_t until = monotonic_ns() + static_cast<int64_t>(most * 1e9);
    bool all = true;
    for (DeviceLink* link : links) all = link->end_thread(until) && all;
    return all;
}

bool DeviceLink::end_thread(int64_t until_ns) {
    const int64_t left = running() ? std::max<int64_t>(until_ns - monotonic_ns(), 0) : 0;
    const bool ended = ended_.wait_for(std::chrono::nanoseconds(left)) == std::future_status::ready;
    if (!running()) return ended;
    if (ended)
        thread_.join();
    else
        thread_.detach();
    return ended;
}

const LinkSample& DeviceChannel::read() {
    sample_.update();
    return sample_.front();
}

void DeviceChannel::write(const DeviceCommand& command, int64_t now_ns) {
    command_.back() = {command, now_ns};
    command_.publish();
}

DeviceCounts DeviceChannel::counts() const {
    DeviceCounts counts;
    for (size_t k = 0; k < counts.size(); ++k) counts[k] = counts_[k].load(std::memory_order_relaxed);
    return counts;
}

void DeviceChannel::publish(const DeviceState& state, int64_t now_ns) {
    sample_.back() = {state, now_ns};
    sample_.publish();
    count(DeviceCount::kAccepted);
}

DeviceCommand DeviceChannel::command(int64_t now_ns, bool& fresh) {
    fresh = command_.update();
    const LinkCommand& newest = command_.front();
    return now_ns - newest.written_ns > kSilence ? DeviceCommand{} : newest.command;
}

void refuse_device(const std::string& specification, const std::string& reason) {
    throw InputError("device " + specification + ": " + reason);
}

const std::vector<DeviceBackend>& device_backends() {
    static const std::vector<DeviceBackend> backends = {
        {"hand", "hand", "simulated hand that circles and gives way to forces, for trying things out", true},
        {"trace", "trace:FILE", "recording of `trocar device record`, at the pace it was made", true},
        {"udp", "udp[:[ADDRESS:]PORT]", "waits for a device that sends packets (docs/devices.md); 127.0.0.1:7731", true},
        {"plugin", "plugin:FILE[?OPTIONS]", "shared library that implements trocar_device.h", true},
        {"haply", "haply[:[HOST:]PORT]", "Haply Inverse service, JSON over WebSocket; localhost:10001", haply_is_built()},
        {"browser", "browser", "the mouse of a live view: `trocar run SCENE --live --view --device BODY=browser`", true},
        {"igtl", "igtl[:[HOST:]PORT]", "OpenIGTLink server: poses in, force out; localhost:18944", igtl_is_built()},
    };
    return backends;
}

std::unique_ptr<DeviceLink> open_device(const std::string& specification) {
    const size_t colon = specification.find(':');
    const std::string word = specification.substr(0, colon);
    const std::string rest = colon == std::string::npos ? "" : specification.substr(colon + 1);
    if (word == "hand") return open_hand();
    if (word == "trace") {
        if (rest.empty()) refuse_device(specification, "write trace:FILE");
        return open_trace(rest);
    }
    if (word == "browser") refuse_device(specification, "it belongs to a live view: trocar run SCENE --live --view --device BODY=browser");
    if (word == "udp") return open_udp_device(specification, parse_address(specification, rest, {"127.0.0.1", 7731}));
    if (word == "plugin") return open_plugin_device(specification, rest);
    if (word == "haply") return open_haply_device(specification, parse_address(specification, rest, {"localhost", 10001}));
    if (word == "igtl") return open_igtl_device(specification, parse_address(specification, rest, {"localhost", 18944}));
    std::string list;
    for (const DeviceBackend& backend : device_backends()) list += (list.empty() ? "" : ", ") + backend.name;
    refuse_device(specification, "there is no such kind of device; there are " + list);
}

}  // namespace trocar
