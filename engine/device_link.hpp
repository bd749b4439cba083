#pragma once
#include <array>
#include <atomic>
#include <functional>
#include <future>
#include <memory>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "components/haptics.hpp"
#include "engine/latest.hpp"
namespace trocar {

// What happened to what a device sent.
enum class DeviceCount : uint8_t {
    kReceived,     // packets or messages, of any kind
    kAccepted,     // became a sample
    kMalformed,    // dropped: no message of the protocol, or values that no device can have
    kOversized,    // dropped: too long
    kOutOfOrder,   // dropped: late, or a second time
    kStranger,     // dropped: from another sender while one is served
    kLost,         // numbers that never came
    kOverrun,      // dropped by the system: they came faster than they were taken
    kSent,         // commands to the device
    kReconnected,  // the device went away and came back
    kCount,
};
const char* describe(DeviceCount count);
using DeviceCounts = std::array<uint64_t, static_cast<size_t>(DeviceCount::kCount)>;

struct LinkSample {
    DeviceState state;        // time by the device's own clock
    int64_t received_ns = 0;  // on the monotonic clock; 0 = none came yet
};
struct LinkCommand {
    DeviceCommand command;
    int64_t written_ns = 0;
};

// What a device's thread and the tick leave for each other: newest values, no locks, no waiting, no allocation on the
// tick's side.
class DeviceChannel {
 public:
    static constexpr int64_t kSilence = 20'000'000;  // ns
    explicit DeviceChannel(std::string name) : name_(std::move(name)) {}
    const std::string& name() const { return name_; }
    DeviceCounts counts() const;

    // Tick: the newest sample; the one of the call before if nothing came.
    const LinkSample& read();
    // Tick: what the device shall do now.
    void write(const DeviceCommand& command, int64_t now_ns);

    // Device thread
    bool stopping() const { return stop_.load(std::memory_order_relaxed); }
    void publish(const DeviceState& state, int64_t now_ns);
    // Newest command, none when it is older than kSilence; `fresh` when it was not given before.
    DeviceCommand command(int64_t now_ns, bool& fresh);
    void count(DeviceCount what, uint64_t by = 1) { counts_[static_cast<size_t>(what)].fetch_add(by, std::memory_order_relaxed); }

    void stop() { stop_.store(true, std::memory_order_relaxed); }

 private:
    std::string name_;
    Latest<LinkSample> sample_;
    Latest<LinkCommand> command_;
    std::array<std::atomic<uint64_t>, static_cast<size_t>(DeviceCount::kCount)> counts_{};
    std::atomic<bool> stop_{false};
};

// A device with a thread of its own that talks to it. When the tick falls silent for kSilence, the device is told to let
// go.
class DeviceLink {
 public:
    using Loop = std::function<void(DeviceChannel&)>;
    // Starts the thread, which runs `loop` until stopping(). `name` is for messages.
    DeviceLink(const std::string& name, Loop loop);
    ~DeviceLink();
    DeviceLink(const DeviceLink&) = delete;
    DeviceLink& operator=(const DeviceLink&) = delete;

    // Tick: see DeviceChannel
    const LinkSample& read() { return channel_->read(); }
    void write(const DeviceCommand& command, int64_t now_ns) { channel_->write(command, now_ns); }
    // Tick: that command no longer; the device lets go at once.
    void let_go() { write({}, 0); }

    // Lets go, gives the device 20 ms to hear it, stops the thread and waits for it, no longer than `most` seconds more;
    // false if it is still inside the device, which no one can end but the end of the program. It is left behind then with
    // what it uses.
    bool close(double most = 1);
    // The same for several at once, which takes no longer than for the slowest of them; whether all came back. `close` of
    // each tells which.
    static bool close_all(std::span<DeviceLink* const> links, double most = 1);

    const std::string& name() const { return channel_->name(); }
    DeviceCounts counts() const { return channel_->counts(); }

 private:
    bool running() const { return thread_.joinable(); }
    // Waits for the thread until then on the monotonic clock, else leaves it behind.
    bool end_thread(int64_t until_ns);

    std::shared_ptr<DeviceChannel> channel_;  // the thread's too
    std::future<void> ended_;
    std::thread thread_;
};

// One way to reach devices.
struct DeviceBackend {
    std::string name;   // first word of a specification
    std::string usage;  // "udp[:[ADDRESS:]PORT]"
    std::string description;
    bool built = true;  // false: its library was absent when this program was built
};
const std::vector<DeviceBackend>& device_backends();

// Opens a device by its specification:
//   hand                      a simulated hand that circles, for trying things out
//   trace:FILE                a recording, at the pace it was made
//   udp[:[ADDRESS:]PORT]      waits for a device that sends packets (127.0.0.1:7731)
//   haply[:[HOST:]PORT]       Haply Inverse service (localhost:10001)
//   igtl[:[HOST:]PORT]        OpenIGTLink server (localhost:18944)
//   plugin:FILE[?OPTIONS]     shared library that implements components/trocar_device.h
// Throws InputError "device SPEC: reason" for what can be told at once; a service that is not there yet is tried again.
std::unique_ptr<DeviceLink> open_device(const std::string& specification);

}  // namespace trocar
