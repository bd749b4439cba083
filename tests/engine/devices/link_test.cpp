#include "engine/devices/link.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>

#include "engine/base/error.hpp"
#include "engine/devices/backends.hpp"
#include "engine/devices/device.hpp"
#include "engine/devices/packets.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/real_time.hpp"
#include "mutate/mutants.hpp"
#include "tests/reference/device_waits.hpp"

namespace trocar {
namespace {

StatePacket some_packet(uint64_t sequence) {
    StatePacket packet;
    packet.sequence = sequence;
    packet.state.time = 1e-3 * static_cast<double>(sequence);
    packet.state.position = {0.01, -0.02, 0.03};
    packet.state.orientation = from_rotation_vector({0.1, 0.2, -0.3});
    packet.state.velocity = {0.1, 0.2, -0.3};
    packet.state.buttons = 5;
    packet.state.grip = 0.25;
    return packet;
}

template <typename Bytes>
mutate::Seed seed_of(const char* name, const Bytes& bytes) {
    return {name, std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size())};
}
std::span<const std::byte> bytes_of(const std::string& text) { return std::as_bytes(std::span(text)); }

std::string refusal(const std::string& specification) {
    try {
        open_device(specification);
    } catch (const InputError& error) {
        return error.what();
    }
    return "";
}

// A UDP socket on loopback.
struct Udp {
    int fd = ::socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in to{};
    explicit Udp(uint16_t port) {
        to.sin_family = AF_INET;
        to.sin_port = htons(port);
        to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    }
    ~Udp() { ::close(fd); }
    void send(const void* data, size_t size) const { ::sendto(fd, data, size, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to); }
    void send(const StatePacket& packet) const {
        const auto bytes = encode_packet(packet);
        send(bytes.data(), bytes.size());
    }
    // Newest answer received; false if there is none yet.
    bool receive(ForcePacket& packet) const {
        std::array<std::byte, 512> bytes;
        bool any = false;
        for (;;) {
            const ssize_t size = ::recv(fd, bytes.data(), bytes.size(), MSG_DONTWAIT);
            if (size < 0) return any;
            any = decode_packet(std::span(bytes).first(static_cast<size_t>(size)), packet) == PacketFault::kNone || any;
        }
    }
};

// An unused port of loopback.
uint16_t free_port(int kind) {
    const int fd = ::socket(AF_INET, kind, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    EXPECT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&address), size), 0);
    ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
    ::close(fd);
    return ntohs(address.sin_port);
}

// ---- packets ----

// The table in docs/devices.md, byte by byte: breaks when a field moves, changes its size or its byte order.
TEST(DevicePackets, LayoutIsThatOfTheDocument) {
    StatePacket packet;
    packet.sequence = 0x0102030405060708;
    packet.state.time = 1;
    packet.state.position = {2, 0, 0};
    packet.state.orientation = {1, 0, 0, 0};
    packet.state.velocity = {0, 0, -1};
    packet.state.buttons = 0xA0B0C0D0;
    packet.state.grip = 0.5;
    const auto bytes = encode_packet(packet);
    const auto at = [&](size_t k) { return static_cast<unsigned>(bytes[k]); };
    ASSERT_EQ(bytes.size(), 120u);
    EXPECT_EQ(std::string(reinterpret_cast<const char*>(bytes.data()), 4), "TRDS");
    EXPECT_EQ(at(4) + 256 * at(5), 1u);
    EXPECT_EQ(at(6) + 256 * at(7), 120u);
    for (unsigned k = 0; k < 8; ++k) EXPECT_EQ(at(8 + k), 8 - k);
    EXPECT_EQ(at(23), 0x3Fu);
    EXPECT_EQ(at(22), 0xF0u);   // time 1.0
    EXPECT_EQ(at(31), 0x40u);   // x = 2.0
    EXPECT_EQ(at(55), 0x3Fu);   // w = 1.0
    EXPECT_EQ(at(103), 0xBFu);  // vz = -1.0
    EXPECT_EQ(at(111), 0x3Fu);
    EXPECT_EQ(at(110), 0xE0u);  // grip 0.5
    EXPECT_EQ(at(112), 0xD0u);
    EXPECT_EQ(at(115), 0xA0u);
    ForcePacket force;
    force.sequence = 1, force.answers = 2, force.time = 1;
    force.command.force = {2, 0, 0};
    force.command.stiffness[8] = -1;
    const auto answer = encode_packet(force);
    ASSERT_EQ(answer.size(), 176u);
    EXPECT_EQ(std::string(reinterpret_cast<const char*>(answer.data()), 4), "TRDF");
    EXPECT_EQ(static_cast<unsigned>(answer[16]), 2u);
    EXPECT_EQ(static_cast<unsigned>(answer[39]), 0x40u);
    EXPECT_EQ(static_cast<unsigned>(answer[175]), 0xBFu);
}

TEST(DevicePackets, ReadBackAndRefused) {
    StatePacket read;
    const StatePacket sent = some_packet(7);
    auto bytes = encode_packet(sent);
    ASSERT_EQ(decode_packet(bytes, read), PacketFault::kNone);
    EXPECT_EQ(read.sequence, 7u);
    EXPECT_EQ(read.state.position, sent.state.position);
    EXPECT_EQ(read.state.velocity, sent.state.velocity);
    EXPECT_EQ(read.state.buttons, 5u);
    EXPECT_EQ(read.state.grip, 0.25);
    EXPECT_NEAR(read.state.orientation.x, sent.state.orientation.x, 1e-15);
    const auto fault_of = [](std::span<const std::byte> b) {
        StatePacket p;
        const PacketFault fault = decode_packet(b, p);
        EXPECT_EQ(p.sequence, 0u);
        return fault;
    };
    EXPECT_EQ(fault_of(std::span(bytes).first(5)), PacketFault::kShort);
    EXPECT_EQ(fault_of(std::span(bytes).first(119)), PacketFault::kShort);
    std::vector<std::byte> longer(bytes.begin(), bytes.end());
    longer.emplace_back();
    EXPECT_EQ(fault_of(longer), PacketFault::kLong);
    auto other = bytes;
    other[4] = std::byte{2};
    EXPECT_EQ(fault_of(other), PacketFault::kVersion);
    other = bytes, other[0] = std::byte{'X'};
    EXPECT_EQ(fault_of(other), PacketFault::kForeign);
    for (const double bad : {std::nan(""), 1e300 * 1e300, -1e300 * 1e300, 1e7}) {
        StatePacket p = sent;
        p.state.position.y() = bad;
        EXPECT_EQ(fault_of(encode_packet(p)), PacketFault::kValue);
        p = sent, p.state.orientation.w = bad;
        EXPECT_EQ(fault_of(encode_packet(p)), PacketFault::kValue);
        p = sent, p.state.velocity.z() = bad;
        EXPECT_EQ(fault_of(encode_packet(p)), PacketFault::kValue);
    }
    StatePacket zero = sent;
    zero.sequence = 0;
    EXPECT_EQ(fault_of(encode_packet(zero)), PacketFault::kValue);
    zero = sent, zero.state.orientation = {0, 0, 0, 0};
    EXPECT_EQ(fault_of(encode_packet(zero)), PacketFault::kValue);
}

TEST(DevicePackets, GateLetsAscendingNumbersThroughAndCountsTheRest) {
    using Verdict = SequenceGate::Verdict;
    SequenceGate gate;
    uint64_t lost = 0;
    EXPECT_EQ(gate.pass(10, 0, lost), Verdict::kNext);  // the first may be any
    EXPECT_EQ(gate.pass(11, 1, lost), Verdict::kNext);
    EXPECT_EQ(lost, 0u);
    EXPECT_EQ(gate.pass(11, 2, lost), Verdict::kStale);
    EXPECT_EQ(gate.pass(9, 3, lost), Verdict::kStale);
    EXPECT_EQ(gate.pass(15, 4, lost), Verdict::kNext);
    EXPECT_EQ(lost, 3u);
    EXPECT_EQ(gate.pass(UINT64_MAX, 5, lost), Verdict::kStale) << "a jump that no device makes";
    EXPECT_EQ(gate.pass(16, 6, lost), Verdict::kNext) << "and which does not silence what follows";
    EXPECT_EQ(lost, 3u);
    EXPECT_EQ(gate.pass(1, 6, lost), Verdict::kStale);
    EXPECT_EQ(gate.pass(1, 7 + SequenceGate::kSilence, lost), Verdict::kNext);  // restarted
    EXPECT_EQ(gate.pass(2, 8 + SequenceGate::kSilence, lost), Verdict::kNext);
}

// Readers given damaged messages return a valid state or nothing, and never end the program.
TEST(DevicePackets, TwentyThousandMutantsAreSoundOrRefused) {
    const std::vector<mutate::Seed> seeds = {
        seed_of("a.state", encode_packet(some_packet(3))), seed_of("b.state", encode_packet(some_packet(1u << 31))),
        seed_of("c.force", encode_packet(ForcePacket{1, 2, 3, {{1, 2, 3}, {4, 5, 6}, {7, 8, 9}, {}}}))};
    size_t read = 0;
    for (uint64_t number = 0; number < 20'000; ++number) {
        const mutate::Seed mutant = mutate::make_mutant(seeds, number);
        StatePacket packet;
        if (decode_packet(bytes_of(mutant.bytes), packet) == PacketFault::kNone) {
            ++read;
            ASSERT_TRUE(packet.state.position.allFinite() && packet.state.velocity.allFinite());
            const Quat& q = packet.state.orientation;
            ASSERT_NEAR(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z, 1, 1e-12);
        }
        ForcePacket force;
        if (decode_packet(bytes_of(mutant.bytes), force) == PacketFault::kNone) {
            ASSERT_TRUE(force.command.force.allFinite());
        }
    }
    EXPECT_GT(read, 100u);
    EXPECT_LT(read, 19'000u);
}

// ---- UDP ----

TEST(DeviceUdp, StatesComeInAndForcesGoOut) {
    const uint16_t port = free_port(SOCK_DGRAM);
    const auto link = open_device("udp:" + std::to_string(port));
    const Udp device(port);
    EXPECT_EQ(link->read().received_ns, 0);
    uint64_t sequence = 0;
    ASSERT_TRUE(wait_until([&] {
        device.send(some_packet(++sequence));
        return link->read().received_ns > 0;
    }));
    EXPECT_EQ(link->read().state.position, some_packet(1).state.position);
    EXPECT_EQ(link->read().state.buttons, 5u);
    DeviceCommand command;
    command.force = {0.5, -1, 2};
    command.at = {1, 2, 3};
    command.stiffness = {1, 2, 3, 2, 5, 6, 3, 6, 9};
    ForcePacket answer;
    ASSERT_TRUE(wait_until([&] {
        link->write(command, monotonic_ns());
        device.send(some_packet(++sequence));
        return device.receive(answer) && answer.command.force == command.force;
    }));
    EXPECT_EQ(answer.command.stiffness, command.stiffness);
    EXPECT_EQ(answer.command.at, command.at);
    EXPECT_GT(answer.answers, 0u);
    EXPECT_LE(answer.answers, sequence);
    // the tick falls silent: the device gets a zero command
    ASSERT_TRUE(wait_until([&] { return device.receive(answer) && answer.command.force.norm() == 0; }));
}

// Every invalid packet is dropped and counted, and the counts add up.
TEST(DeviceUdp, BadPacketsAreDroppedAndCounted) {
    const uint16_t port = free_port(SOCK_DGRAM);
    const auto link = open_device("udp:127.0.0.1:" + std::to_string(port));
    const Udp device(port), stranger(port);
    for (const uint64_t sequence : {1, 2, 5, 4, 2, 6}) device.send(some_packet(sequence));
    const auto received = [&](uint64_t n) { return wait_until([&] { return count_of(*link, DeviceCount::kReceived) == n; }); };
    ASSERT_TRUE(received(6));
    stranger.send(some_packet(7));
    ASSERT_TRUE(received(7));
    device.send("hello", 5);
    const std::vector<char> large(3000, 'x');
    device.send(large.data(), large.size());
    const std::vector<char> little_more(130, 'x');
    device.send(little_more.data(), little_more.size());
    StatePacket nan = some_packet(8);
    nan.state.position.x() = std::nan("");
    device.send(nan);
    device.send("", 0);
    ASSERT_TRUE(received(12));
    EXPECT_EQ(count_of(*link, DeviceCount::kAccepted), 4u);    // 1 2 5 6
    EXPECT_EQ(count_of(*link, DeviceCount::kOutOfOrder), 2u);  // 4 2
    EXPECT_EQ(count_of(*link, DeviceCount::kLost), 2u);        // 3 4
    EXPECT_EQ(count_of(*link, DeviceCount::kStranger), 1u);
    EXPECT_EQ(count_of(*link, DeviceCount::kOversized), 1u);
    EXPECT_EQ(count_of(*link, DeviceCount::kMalformed), 4u);
    EXPECT_EQ(link->read().state.time, some_packet(6).state.time);
}

// A flood during a ticking run: every packet is accounted for, the newest one arrives, and the tick
// continues.
TEST(DeviceUdp, AFloodIsAccountedForWhileTheTickGoesOn) {
    const uint16_t port = free_port(SOCK_DGRAM);
    const auto link = open_device("udp:" + std::to_string(port));
    const Udp device(port);
    PeriodicThread tick;
    PeriodicOptions options;
    options.real_time = false;
    std::atomic<uint64_t> ticks{0}, last{0};
    std::atomic<bool> went_back{false};
    tick.start(options, monotonic_ns(), [&](uint64_t, int64_t now) {
        const uint64_t newest = static_cast<uint64_t>(std::llround(link->read().state.time * 1e3));
        if (newest < last) went_back = true;
        last = newest;
        link->write({}, now);
        ++ticks;
    });
    constexpr uint64_t kPackets = 30'000;
    for (uint64_t sequence = 1; sequence <= kPackets; ++sequence) {
        device.send(some_packet(sequence));
        if (sequence % 7 == 0) device.send("garbage", 7);
    }
    constexpr uint64_t kSent = kPackets + kPackets / 7;
    const auto accounted = [&] { return count_of(*link, DeviceCount::kReceived) + count_of(*link, DeviceCount::kOverrun); };
    // the system reports its dropped packets with the next one that it delivers
    uint64_t extra = 0;
    ASSERT_TRUE(wait_until([&] {
        device.send(some_packet(kPackets + ++extra));
        return last > kPackets && accounted() >= kSent;
    }));
    const uint64_t before = ticks;
    ASSERT_TRUE(wait_until([&] { return ticks > before + 5; }));
    tick.stop();
    ASSERT_TRUE(wait_until([&] { return accounted() == kSent + extra; })) << accounted() << " of " << kSent + extra;
    EXPECT_FALSE(went_back);
    const DeviceCounts c = link->counts();
    const auto of = [&](DeviceCount what) { return c[static_cast<size_t>(what)]; };
    EXPECT_EQ(of(DeviceCount::kReceived), of(DeviceCount::kAccepted) + of(DeviceCount::kMalformed));
    EXPECT_EQ(of(DeviceCount::kOutOfOrder) + of(DeviceCount::kStranger) + of(DeviceCount::kOversized), 0u);
    EXPECT_GT(of(DeviceCount::kAccepted), 0u);
}

// ---- specifications ----

TEST(DeviceOpen, BadSpecificationsAreRefusedWithTheReason) {
    EXPECT_NE(refusal("joystick").find("device joystick: there is no such kind of device; there are hand, trace, udp"), std::string::npos);
    EXPECT_NE(refusal("udp:99999").find("no port"), std::string::npos);
    EXPECT_NE(refusal("udp:0").find("no port"), std::string::npos);
    EXPECT_NE(refusal("udp:12x").find("no port"), std::string::npos);
    EXPECT_NE(refusal("udp::7000").find("empty"), std::string::npos);
    EXPECT_NE(refusal("udp:nowhere:7000").find("IPv4"), std::string::npos);
    EXPECT_NE(refusal("udp:192.0.2.1:7000").find("cannot listen"), std::string::npos);
    EXPECT_NE(refusal("trace:").find("trace:FILE"), std::string::npos);
    EXPECT_NE(refusal("trace:/nonexistent.csv").find("/nonexistent.csv"), std::string::npos);
    EXPECT_NE(refusal("plugin:").find("plugin:FILE"), std::string::npos);
    EXPECT_NE(refusal("plugin:/nonexistent.so").find("nonexistent"), std::string::npos);
    EXPECT_NE(refusal("").find("no such kind"), std::string::npos);
}

TEST(DeviceOpen, TwoOnOnePortAreRefused) {
    const uint16_t port = free_port(SOCK_DGRAM);
    const auto first = open_device("udp:" + std::to_string(port));
    EXPECT_NE(refusal("udp:" + std::to_string(port)).find("in use"), std::string::npos);
}

TEST(DeviceOpen, ARecordingPlaysAtItsPace) {
    const std::filesystem::path file = std::filesystem::temp_directory_path() / ("trocar_link_" + std::to_string(::getpid()) + ".csv");
    std::vector<DeviceState> samples(30);
    for (size_t k = 0; k < samples.size(); ++k) {
        samples[k].time = 5 + 2e-3 * static_cast<double>(k);
        samples[k].position.x() = static_cast<double>(k);
        samples[k].grip = 0.01 * static_cast<double>(k);
    }
    write_device_trace(file, samples);
    const auto link = open_device("trace:" + file.string());
    std::filesystem::remove(file);
    ASSERT_TRUE(wait_until([&] { return link->read().state.position.x() == 29; }));
    EXPECT_EQ(link->read().state.grip, 0.01 * 29);
    EXPECT_EQ(count_of(*link, DeviceCount::kReceived), 30u);
}

// ---- devices that do not come back ----

// A device's thread that hangs is abandoned after the given time, with everything it uses; one that returns
// is waited for. Without the bound a plug-in that blocks would lose a run's results.
TEST(DeviceLink, AHangingDeviceIsLeftBehind) {
    std::atomic<bool> release = false, gone = false;
    {
        DeviceLink link("stuck", [&](DeviceChannel& channel) {
            while (!release) sleep_until_ns(monotonic_ns() + 1'000'000);
            EXPECT_TRUE(channel.stopping());
            channel.publish({}, monotonic_ns());  // the link no longer exists
            gone = true;
        });
        EXPECT_FALSE(link.close(0.02));
        EXPECT_FALSE(link.close(0.02));
    }
    release = true;
    EXPECT_TRUE(wait_until([&] { return gone.load(); }));
    DeviceLink link("sound", [](DeviceChannel& channel) {
        while (!channel.stopping()) sleep_until_ns(monotonic_ns() + 1'000'000);
    });
    EXPECT_TRUE(link.close(60));
    EXPECT_TRUE(link.close(60));
}

// Several hanging devices cost the time of one, and one that returns in the meantime is not abandoned with
// them. Waited for in turn, five would take five times as long.
TEST(DeviceLink, HangingDevicesAreWaitedForAllAtOnce) {
    constexpr int kStuck = 5;
    constexpr double kMost = 0.4;  // s
    std::atomic<bool> release = false;
    std::atomic<int> gone = 0;
    std::vector<std::unique_ptr<DeviceLink>> owned;
    for (int k = 0; k < kStuck; ++k) {
        owned.push_back(std::make_unique<DeviceLink>("stuck", [&](DeviceChannel&) {
            while (!release) sleep_until_ns(monotonic_ns() + 1'000'000);
            ++gone;
        }));
    }
    owned.push_back(std::make_unique<DeviceLink>("slow", [](DeviceChannel& channel) {
        while (!channel.stopping()) sleep_until_ns(monotonic_ns() + 1'000'000);
        sleep_until_ns(monotonic_ns() + 50'000'000);
    }));
    std::vector<DeviceLink*> links;
    for (const auto& link : owned) links.push_back(link.get());
    const int64_t start = monotonic_ns();
    EXPECT_FALSE(DeviceLink::close_all(links, kMost));
    for (int k = 0; k < kStuck; ++k) EXPECT_FALSE(links[k]->close(kMost)) << k;
    EXPECT_TRUE(links.back()->close(kMost));
    EXPECT_LT(1e-9 * static_cast<double>(monotonic_ns() - start), 3 * kMost) << "one after another";
    release = true;
    EXPECT_TRUE(wait_until([&] { return gone == kStuck; }));
    EXPECT_TRUE(DeviceLink::close_all({}, kMost));
}

// ---- plug-ins ----

// The example of the documents, built by the test suite: it accelerates by F/m.
TEST(DevicePlugin, TheExampleIsMovedByForces) {
    const std::string file = TROCAR_EXAMPLE_DEVICE;
    EXPECT_NE(refusal("plugin:" + file + "?mass=-1").find("write mass=KILOGRAMS"), std::string::npos);
    const auto link = open_device("plugin:" + file + "?mass=0.5");
    EXPECT_EQ(link->name(), "plug-in puck");
    ASSERT_TRUE(wait_until([&] { return link->read().received_ns > 0; }));
    EXPECT_EQ(link->read().state.position.norm(), 0);
    DeviceCommand command;
    command.force = {0, 3, 0};
    // terminal speed in its oil: 3 N / 2 N s/m
    ASSERT_TRUE(wait_until([&] {
        link->write(command, monotonic_ns());
        return std::abs(link->read().state.velocity.y() - 1.5) < 1e-3;
    }));
    EXPECT_EQ(link->read().state.velocity.x(), 0);
    // and when the tick falls silent it comes to rest: no command outlives the tick
    ASSERT_TRUE(wait_until([&] { return std::abs(link->read().state.velocity.y()) < 1e-3; }));
    EXPECT_GT(count_of(*link, DeviceCount::kSent), 0u);
}

TEST(DevicePlugin, ALibraryThatIsNoneIsRefused) {
    EXPECT_NE(refusal("plugin:" + std::string(TROCAR_NO_DEVICE)).find("no function trocar_device"), std::string::npos);
}

}  // namespace
}  // namespace trocar
