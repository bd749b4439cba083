#pragma once
namespace trocar {

// While an object of this class exists, the first SIGINT, SIGTERM or SIGHUP is remembered instead of ending
// the program: a run then stops after the current pass and writes its results. A second signal ends the
// program at once. One object at a time.
class StopOnSignal {
 public:
    StopOnSignal();
    ~StopOnSignal();
    StopOnSignal(const StopOnSignal&) = delete;
    StopOnSignal& operator=(const StopOnSignal&) = delete;
};

// The signal received; 0 = none.
int stop_signal();

// The exit code that shells expect after a signal.
inline int exit_code_of_signal(int signal) { return 128 + signal; }

// "SIGINT" and the like.
const char* name_of_signal(int signal);

}  // namespace trocar
