#pragma once
#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "systems/app/view/browser_hand.hpp"
#include "systems/app/view/view_command.hpp"
#include "systems/app/view/view_server.hpp"
namespace trocar {

// A run in the browsers of this machine (docs/player.md): its bodies, contacts, forces and costs as they are, and buttons that
// pause it, step it, change its speed, start it again and end it. The first client holds the run: only its buttons and its mouse
// count; who comes later watches, and may take over when it has left.
class LiveView {
 public:
    // Serves from now on; port 0: any free one. Throws InputError.
    explicit LiveView(uint16_t port);
    ~LiveView();

    std::string address() const { return server_.address(); }
    // A world to show, from its start. `paced`: the run waits for wait_for_turn, so that its speed can be chosen.
    void attach(const Frame& frame, const std::string& scene, const Camera& camera, bool paced);
    // A run against the real clock: the tool of `body` follows the mouse of whoever holds the run. `start`: what its device says at
    // the start.
    std::unique_ptr<DeviceLink> open_device(uint32_t body, const HandTool& tool, const DeviceState& start);
    // Shows the state after a pass, if the last one shown is a picture's time old.
    void after_pass(const Frame& frame, std::span<const uint64_t> stage_ns);
    // Waits until the next pass is due; false if the run should end here. Paused, it serves who comes.
    bool wait_for_turn(const Frame& frame);
    // A run against the real clock: waits while it is paused; false if the run should end here.
    bool wait_while_paused(const Frame& frame);
    // Any thread: the run should end.
    void end() { ended_ = true; }
    // Whether it should end because it shall start again; false from then on.
    bool take_reset() { return reset_.exchange(false); }
    // What the client that holds the run has asked for since the last call, in its order; of pulls that follow each other the last.
    std::vector<ViewCommand> take_commands();
    // Whether it has asked for a capture since the last call.
    bool take_capture() { return capture_.exchange(false); }
    // Whether it may: the run keeps passes to write.
    void offer_captures(bool offered) { captures_ = offered; }
    // Tells all clients something, until the next is told: what came of a command.
    void tell(const std::string& text);

    // Any thread: what a client (0: this program, while nobody holds the run) may send as JSON {"do": ..., ...}; whatever is not
    // understood is ignored.
    void obey(uint32_t client, const std::string& text);

    static constexpr size_t kMostCommands = 64;  // waiting for the next pass; more are ignored

 private:
    void add_command(const std::string& text);
    enum class Turn { kGo, kStep, kEnd };
    Turn wait(const Frame& frame);  // while it is paused
    void show(const Frame& frame);
    void left(uint32_t client);
    bool goes_on() const;
    void start_clock(const Frame& frame);
    std::string status(uint32_t client) const;

    // Written by the server's thread, which obeys the clients.
    std::atomic<uint32_t> holder_{0};  // 0 = nobody
    std::atomic<bool> paused_{false}, reset_{false}, ended_{false};
    std::atomic<uint32_t> steps_{0};                          // passes to make although paused
    std::atomic<double> speed_{1};                            // of real time
    std::mutex hands_lock_;                                   // of hands_: the server's thread aims, the simulation opens them
    std::map<uint32_t, std::shared_ptr<BrowserHand>> hands_;  // by body
    std::atomic<bool> capture_{false}, captures_{false}, grabs_{false};
    mutable std::mutex commands_lock_;   // of what follows: the server's thread adds, the simulation takes
    std::vector<ViewCommand> commands_;  // at most kMostCommands
    std::string told_;

    // The simulation's.
    std::optional<PlayerCoder> coder_;
    std::string scene_;
    Camera camera_;
    bool paced_ = true;
    std::vector<uint64_t> stage_ns_;  // of the last pass
    bool shown_ = false;              // the last pass
    int64_t shown_ns_ = 0;            // when the last frame was
    int64_t clock_ns_ = 0;            // when ...
    uint64_t clock_tick_ = 0;         // ... this tick was due
    double clock_speed_ = 1;          // at this speed
    double rate_ = 0;                 // simulated time over real time, of late
    int64_t rate_ns_ = 0;
    uint64_t rate_tick_ = 0;
    double time_ = 0;    // s, simulated
    ViewServer server_;  // last: its thread uses what is above
};

}  // namespace trocar
