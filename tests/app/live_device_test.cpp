#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "engine/base/error.hpp"
#include "engine/devices/device.hpp"
#include "systems/haptics/live_haptics.hpp"
#include "tests/app/run_program.hpp"
#include "tests/reference/local_patches.hpp"

// Devices with threads of their own in addition to the haptic thread, and the commands that use them.
namespace trocar {
namespace {
namespace fs = std::filesystem;

struct Recording {
    std::vector<LiveTick> tick;
    std::atomic<size_t> count = 0;
    std::atomic<size_t> pressed = 0;  // ticks with a force of at least 0.2 N
    std::atomic<size_t> old = 0;      // ticks on a sample at least a quarter of a second old
    static void record(void* user, const LiveTick& tick) {
        Recording& r = *static_cast<Recording*>(user);
        if (tick.force.norm() > 0.2) ++r.pressed;
        if (tick.time - tick.sample.time > 0.25) ++r.old;
        if (r.count < r.tick.size()) r.tick[r.count] = tick, ++r.count;
    }
};

// Commands of a test to the device's thread.
struct Hand {
    std::atomic<bool> down = false, unplugged = false;
    std::atomic<double> felt{-1};
};

// A device that reports every millisecond. Once `down`, it moves to 2 mm above the centre of the plane, where
// a tip of 3 mm is pressed in by 1 mm, and stays there; once `unplugged` it sends nothing.
DeviceLink::Loop pressing_device(Hand& hand) {
    return [&hand](DeviceChannel& link) {
        const int64_t start = monotonic_ns();
        double height = 0.01;
        for (int ms = 0; !link.stopping(); ++ms) {
            sleep_until_ns(start + ms * 1'000'000);
            bool fresh = false;
            hand.felt = link.command(monotonic_ns(), fresh).force.norm();
            if (hand.unplugged) continue;
            if (hand.down) height = std::max(0.002, height - 0.0002);
            DeviceState state;
            state.time = 1000 + ms * 1e-3;  // a clock of its own
            state.position = {0, 0, height};
            link.publish(state, monotonic_ns());
        }
    };
}

// Regardless of this machine's timing, no tick produces a force from a sample older than the watchdog allows
// (here 100 ms plus a 5 ms ramp), and the last command to the device's thread is zero.
TEST(LiveDevice, T15_AnUnpluggedDeviceIsLetGo) {
    Recording recording;
    recording.tick.resize(40'000);
    Hand hand;
    DeviceLink link("test", pressing_device(hand));
    LiveTool tool;
    tool.tool.tip_radius = 3e-3;
    tool.link = &link;
    HapticParams params;
    params.model_timeout = 1e9;
    params.device_timeout = 0.1;  // far longer than the machine's load delays the device's thread
    LiveHaptics live(params, std::span(&tool, 1), {&Recording::record, &recording});
    live.model_to_fill(0) = reference::make_patch(reference::make_plane());
    live.publish_model(0);
    PeriodicOptions options;
    options.real_time = false;
    live.start(options, monotonic_ns());
    // a tip that is down before the first tick would start inside the surface and be released softly
    for (int k = 0; k < 15'000 && recording.count == 0; ++k) sleep_until_ns(monotonic_ns() + 1'000'000);
    hand.down = true;
    for (int k = 0; k < 15'000 && recording.pressed < 50; ++k) sleep_until_ns(monotonic_ns() + 1'000'000);
    hand.unplugged = true;
    const size_t old = recording.old;  // the machine's load may have aged samples already
    for (int k = 0; k < 15'000 && recording.old < old + 50; ++k) sleep_until_ns(monotonic_ns() + 1'000'000);
    for (int k = 0; k < 10'000 && hand.felt != 0; ++k) sleep_until_ns(monotonic_ns() + 1'000'000);
    live.stop();
    size_t stale = 0;
    double allowed = 0;
    for (size_t k = 0; k < recording.count; ++k) {
        const LiveTick& t = recording.tick[k];
        const double age = t.time - t.sample.time;
        // (a missed tick leaves its part of the ramp to the next one)
        const double step = k > 0 ? t.time - recording.tick[k - 1].time : 0;
        if (age <= params.device_timeout + params.fall_time + std::max(step, 1e-3)) continue;
        ++stale;
        allowed = std::max(allowed, t.force.norm());
    }
    EXPECT_GE(recording.pressed, 50u);
    EXPECT_GT(stale, 20u);
    EXPECT_EQ(allowed, 0);
    EXPECT_EQ(hand.felt, 0);
}

// Ticks stop while the hand presses: the device's own thread sets the force to zero.
TEST(LiveDevice, AStoppedTickLetsTheDeviceGo) {
    Hand hand;
    DeviceLink link("test", pressing_device(hand));
    DeviceCommand command;
    command.force = {0, 0, 2};
    while (hand.felt != 2) {
        link.write(command, monotonic_ns());
        sleep_until_ns(monotonic_ns() + 500'000);
    }
    for (int k = 0; k < 10'000 && hand.felt > 0; ++k) sleep_until_ns(monotonic_ns() + 1'000'000);
    EXPECT_EQ(hand.felt, 0);
}

// A tool whose device has sent no sample neither ticks nor records.
TEST(LiveDevice, ASilentDeviceDoesNotTick) {
    Recording recording;
    recording.tick.resize(1000);
    DeviceLink link("test", [](DeviceChannel& self) {
        while (!self.stopping()) sleep_until_ns(monotonic_ns() + 1'000'000);
    });
    LiveTool tool;
    tool.tool.tip_radius = 3e-3;
    tool.link = &link;
    LiveHaptics live({}, std::span(&tool, 1), {&Recording::record, &recording});
    PeriodicOptions options;
    options.real_time = false;
    live.start(options, monotonic_ns());
    sleep_until_ns(monotonic_ns() + 30'000'000);
    live.stop();
    EXPECT_EQ(recording.count, 0u);
    EXPECT_GT(live.timing().compute.count, 0u);
}

// ---- commands ----

sockaddr_in loopback(uint16_t port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return address;
}

// An unused UDP port on the loopback interface.
uint16_t free_udp_port() {
    const int fd = ::socket(AF_INET, SOCK_DGRAM, 0);
    sockaddr_in address = loopback(0);
    socklen_t size = sizeof address;
    EXPECT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&address), size), 0);
    ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
    ::close(fd);
    return ntohs(address.sin_port);
}

void send_garbage(uint16_t port, const std::atomic<bool>& stop) {
    const int fd = ::socket(AF_INET, SOCK_DGRAM, 0);
    const sockaddr_in to = loopback(port);
    while (!stop) {
        ::sendto(fd, "garbage", 7, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
        sleep_until_ns(monotonic_ns() + 1'000'000);
    }
    ::close(fd);
}

struct DeviceCommands : testing::Test {
    fs::path folder = fs::temp_directory_path() / ("trocar_device_command_" + std::to_string(::getpid()));
    void SetUp() override { fs::create_directories(folder); }
    void TearDown() override { fs::remove_all(folder); }
    Outcome run(const std::string& arguments) const { return run_program(arguments, source_folder(), folder); }
};

TEST_F(DeviceCommands, ListNamesEveryKind) {
    const Outcome list = run("device list");
    EXPECT_EQ(list.code, 0);
    for (const char* kind : {"hand", "trace:FILE", "udp", "plugin:FILE", "haply", "igtl"})
        EXPECT_NE(list.out.find(kind), std::string::npos) << kind;
    EXPECT_EQ(run("device list --json").out[0], '[');
    EXPECT_NE(run("device --help").out.find("trocar device test udp:7731"), std::string::npos);
}

// A recording plays back to the same numbers, both as a device and as a file.
TEST_F(DeviceCommands, RecordTestAndPlayAgain) {
    const fs::path file = folder / "hand.csv";
    const Outcome record = run("device record hand --seconds 0.2 --out " + file.string());
    EXPECT_EQ(record.code, 0) << record.err;
    const DeviceTrace trace = read_device_trace(file);
    EXPECT_GT(trace.sample.size(), 10u);
    const Outcome test = run("device test trace:" + file.string() + " --seconds 0.5 --json");
    EXPECT_EQ(test.code, 0) << test.err;
    EXPECT_NE(test.out.find("\"received\": " + std::to_string(trace.sample.size())), std::string::npos) << test.out;
    const Outcome spring = run("device test hand --seconds 0.2 --spring 100");
    EXPECT_EQ(spring.code, 0);
    EXPECT_NE(spring.out.find("simulated hand"), std::string::npos);
}

TEST_F(DeviceCommands, SilenceIsNoAndNonsenseIsAnError) {
    const Outcome silent = run("device record haply:127.0.0.1:9 --seconds 0.05 --out " + (folder / "none.csv").string());
    EXPECT_TRUE(silent.code == 1 || silent.code == 2) << silent.code;  // 2 if built without the library
    EXPECT_FALSE(fs::exists(folder / "none.csv"));
    EXPECT_EQ(run("device test gloves").code, 2);
    EXPECT_EQ(run("device test").code, 2);
    EXPECT_EQ(run("device").code, 2);
    const Outcome body = run("run probe_on_liver --live --seconds 0.1 --set liver.triangles=200 --device nobody=hand");
    EXPECT_EQ(body.code, 2);
    EXPECT_NE(body.err.find("no tool on a body named \"nobody\""), std::string::npos) << body.err;
    EXPECT_EQ(run("run probe_on_liver --device probe=hand").code, 2);  // without --live
}

// A live run whose tool is held by a device is repeated from its recording, without the device, bit for bit.
TEST_F(DeviceCommands, ALiveRunWithADeviceReplaysToTheSameBits) {
    const std::string scene =
        "run probe_on_liver --no-render --set liver.triangles=300 --set probe.triangles=300 "
        "--set tool.probe.workspace.origin=[0,0,0.03] --set tool.probe.workspace.scale=1.5";
    const Outcome live = run(scene + " --live --seconds 0.4 --device probe=hand --out " + (folder / "live").string());
    EXPECT_EQ(live.code, 0) << live.err;
    const Outcome again = run(scene + " --replay " + (folder / "live/live.recording").string());
    EXPECT_EQ(again.code, 0) << again.out << again.err;
    EXPECT_NE(again.out.find("the same to the bit"), std::string::npos) << again.out;
}

// A requested device that delivers no usable sample is an error, even if the run succeeded otherwise; the
// packets it sent are counted by kind.
TEST_F(DeviceCommands, ALiveRunWhoseDeviceGivesNothingFails) {
    const std::string scene = "run probe_on_liver --live --no-render --seconds 0.3 --set liver.triangles=300 --set probe.triangles=300 ";
    const uint16_t port = free_udp_port();
    const std::string device = "--device probe=udp:" + std::to_string(port);
    const fs::path out = folder / "silent";
    const Outcome silent = run(scene + device + " --out " + out.string());
    EXPECT_EQ(silent.code, 1) << silent.err;
    EXPECT_NE(silent.err.find("0 samples accepted, refused in 0 ticks\n"), std::string::npos) << silent.err;
    EXPECT_NE(silent.err.find("error: UDP 127.0.0.1:" + std::to_string(port) + " gave no usable sample"), std::string::npos) << silent.err;
    const nlohmann::json metrics = nlohmann::json::parse(std::ifstream(out / "metrics.json"));
    EXPECT_EQ(metrics["haptics"]["tools"][0]["device_heard"], false);
    EXPECT_EQ(metrics["haptics"]["tools"][0]["counts"]["accepted"], 0);
    EXPECT_NE(silent.out.find(", live.recording"), std::string::npos) << silent.out;
    EXPECT_TRUE(fs::exists(out / "live.recording"));
    std::stringstream page;
    page << std::ifstream(out / "report.html").rdbuf();
    EXPECT_NE(page.str().find("0 samples accepted"), std::string::npos);

    std::atomic<bool> stop = false;
    std::thread sender([&] { send_garbage(port, stop); });
    const Outcome garbage = run(scene + device);
    stop = true;
    sender.join();
    EXPECT_EQ(garbage.code, 1) << garbage.err;
    EXPECT_NE(garbage.err.find("0 samples accepted"), std::string::npos) << garbage.err;
    EXPECT_NE(garbage.err.find(", malformed "), std::string::npos) << garbage.err;

    const Outcome heard = run(scene + "--device probe=hand --set tool.probe.workspace.origin=[0,0,0.03] --json");
    EXPECT_EQ(heard.code, 0) << heard.err;
    EXPECT_NE(heard.err.find("\"probe\" was held by simulated hand: "), std::string::npos) << heard.err;
    EXPECT_EQ(heard.err.find("error"), std::string::npos) << heard.err;
    EXPECT_EQ(nlohmann::json::parse(heard.out)["haptics"]["tools"][0]["device_heard"], true);
}

// A message from a plug-in is printed as one line without control characters.
TEST_F(DeviceCommands, WhatAPlugInSaysIsOneLine) {
    std::ofstream(folder / "loud.c") << "#include \"trocar_device.h\"\n#include <stdio.h>\n"
                                        "static void* open(const char* o, char* error, size_t size) {\n"
                                        "    (void)o; snprintf(error, size, \"no\\nmotor \\x1b[2J\"); return NULL;\n}\n"
                                        "static trocar_exchange step(void* d, const trocar_device_command* c, trocar_device_state* s) {\n"
                                        "    (void)d; (void)c; (void)s; return TROCAR_NONE;\n}\n"
                                        "static void close(void* d) { (void)d; }\n"
                                        "const trocar_device_api* trocar_device(void) {\n"
                                        "    static const trocar_device_api api = {1, \"loud\", open, step, close}; return &api;\n}\n";
    const std::string build = "cc -std=c11 -shared -fPIC -I " + (source_folder() / "components").string() + " -o " +
                              (folder / "loud.so").string() + " " + (folder / "loud.c").string();
    ASSERT_EQ(std::system(build.c_str()), 0);
    const Outcome outcome = run("device test plugin:" + (folder / "loud.so").string());
    EXPECT_EQ(outcome.code, 2);
    EXPECT_NE(outcome.err.find("no\\nmotor \\x1b[2J"), std::string::npos) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
}

// ---- scenes ----

// Each invalid table is rejected with its position and a reason.
TEST_F(DeviceCommands, WrongTablesOfAToolAreRefusedWithTheirPlace) {
    const struct {
        std::string key, reason;
    } cases[] = {
        {"tool.probe.effect=[{kind=\"tickle\"}]", "is none of spring_to_point"},
        {"tool.probe.effect=[{kind=\"constant\"}]", "a constant needs force"},
        {"tool.probe.effect=[{kind=\"vibration\",force=1}]", "a vibration needs frequency"},
        {"tool.probe.effect=[{kind=\"vibration\",force=1,frequency=900}]", "outside 0 to 500"},
        {"tool.probe.effect=[{kind=\"constant\",force=1,when=\"button\"}]", "needs buttons"},
        {"tool.probe.effect=[{kind=\"constant\",force=1,direction=[0,0,0]}]", "no length"},
        {"tool.probe.effect=[{kind=\"constant\",farce=1}]", "did you mean \"force\""},
        {"tool.probe.effect=[{}]", "needs a kind"},
        {"tool.probe.effect=3", "write [[effect]]"},
        {"tool.probe.hand.stiffness=200", "only with a mass"},
        {"tool.probe.hand.delay=9", "outside 0 to 7"},
        {"tool.probe.workspace.scale=0", "outside"},
        {"tool.probe.pivot.device=\"elbow\"", "none of handle, tip"},
        {"tool.probe.pivot.lenght=1", "did you mean \"length\""},
        {"tool.probe.limits.torque=-1", "outside"},
        {"tool.probe.dof=4", "dof is 3"},
        {"tool.probe.points=100", "points"},
        {"tool.probe.pass_through=-1", "outside"},
    };
    for (const auto& c : cases) {
        const Outcome outcome = run("run probe_on_liver --no-render --seconds 0.1 --set '" + c.key + "'");
        EXPECT_EQ(outcome.code, 2) << c.key;
        EXPECT_NE(outcome.err.find(c.reason), std::string::npos) << c.key << ": " << outcome.err;
        EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    }
}

}  // namespace
}  // namespace trocar
