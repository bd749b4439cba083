#include "systems/app/console/stop_signal.hpp"

#include <csignal>
namespace trocar {
namespace {

constexpr int kStops[] = {SIGINT, SIGTERM, SIGHUP};

volatile std::sig_atomic_t stop_asked = 0;

void remember(int signal) {
    stop_asked = signal;
    for (const int stop : kStops) std::signal(stop, SIG_DFL);
}

}  // namespace

StopOnSignal::StopOnSignal() {
    stop_asked = 0;
    for (const int stop : kStops) {
        if (std::signal(stop, remember) == SIG_IGN) std::signal(stop, SIG_IGN);  // nohup wants it ignored
    }
}
StopOnSignal::~StopOnSignal() {
    for (const int stop : kStops) {
        if (std::signal(stop, SIG_DFL) == SIG_IGN) std::signal(stop, SIG_IGN);
    }
}

int stop_signal() { return stop_asked; }

const char* name_of_signal(int signal) { return signal == SIGINT ? "SIGINT" : signal == SIGTERM ? "SIGTERM" : "SIGHUP"; }

}  // namespace trocar
