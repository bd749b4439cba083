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

#include "components/device.hpp"
#include "engine/base/latest.hpp"
namespace trocar {

// Outcomes for data that a device sent.
enum class DeviceCount : uint8_t {
    kReceived,     // packets or messages, of any kind
    kAccepted,     // became a sample
    kMalformed,    // dropped: no message of the protocol, or invalid values
    kOversized,    // dropped: too long
    kOutOfOrder,   // dropped: late or repeated
    kStranger,     // dropped: from another sender while one is served
    kLost,         // sequence numbers that never arrived
    kOverrun,      // dropped by the system: they arrived faster than they were read
    kSent,         // commands to the device
    kReconnected,  // the device disappeared and came back
    kCount,
};
const char* describe(DeviceCount count);
using DeviceCounts = std::array<uint64_t, static_cast<size_t>(DeviceCount::kCount)>;

struct LinkSample {
    DeviceState state;        // time by the device's own clock
    int64_t received_ns = 0;  // on the monotonic clock; 0 = none received yet
};
struct LinkCommand {
    DeviceCommand command;
    int64_t written_ns = 0;
};

// Exchange between a device's thread and the tick: newest values only; no locks, waits or allocation in the
// tick.
class DeviceChannel {
 public:
    static constexpr int64_t kSilence = 20'000'000;  // ns
    explicit DeviceChannel(std::string name) : name_(std::move(name)) {}
    const std::string& name() const { return name_; }
    DeviceCounts counts() const;

    // Tick: the newest sample; that of the last call if none arrived.
    const LinkSample& read();
    // Tick: the new command of the device.
    void write(const DeviceCommand& command, int64_t now_ns);

    // Device thread
    bool stopping() const { return stop_.load(std::memory_order_relaxed); }
    void publish(const DeviceState& state, int64_t now_ns);
    // Newest command, zero if older than kSilence; `fresh` if it was not returned yet.
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

// A device with a thread of its own that communicates with it. If the tick is silent for kSilence, the device
// gets a zero command.
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
    // Tick: cancels the command; the device gets zero force at once.
    void let_go() { write({}, 0); }

    // Sends a zero command, gives the device 20 ms to receive it, stops the thread and waits for it for at
    // most `most` seconds more. False if the thread still hangs inside the device: it can only end with the
    // program, so it is abandoned with everything it uses.
    bool close(double most = 1);
    // The same for several devices at once, in the time of the slowest; true if all threads ended. `close` of
    // each tells which did.
    static bool close_all(std::span<DeviceLink* const> links, double most = 1);

    const std::string& name() const { return channel_->name(); }
    DeviceCounts counts() const { return channel_->counts(); }

 private:
    bool running() const { return thread_.joinable(); }
    // Waits for the thread until then on the monotonic clock, else abandons it.
    bool end_thread(int64_t until_ns);

    std::shared_ptr<DeviceChannel> channel_;  // the thread's too
    std::future<void> ended_;
    std::thread thread_;
};

// A type of connection to devices.
struct DeviceBackend {
    std::string name;   // first word of a specification
    std::string usage;  // "udp[:[ADDRESS:]PORT]"
    std::string description;
    bool built = true;  // false: its library was absent when this program was built
};
const std::vector<DeviceBackend>& device_backends();

// Opens a device by its specification:
//   hand                      a simulated hand that moves on circles, for trials
//   trace:FILE                a recording, in real time
//   udp[:[ADDRESS:]PORT]      waits for a device that sends packets (127.0.0.1:7731)
//   haply[:[HOST:]PORT]       Haply Inverse service (localhost:10001)
//   browser                   refused here: LiveView opens it
//   igtl[:[HOST:]PORT]        OpenIGTLink server (localhost:18944)
//   plugin:FILE[?OPTIONS]     shared library that implements components/trocar_device.h
// Throws InputError "device SPEC: reason" for errors known at once; a service not yet running is tried again.
std::unique_ptr<DeviceLink> open_device(const std::string& specification);

}  // namespace trocar
