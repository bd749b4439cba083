#pragma once
namespace trocar {

// While it lives SIGINT, SIGTERM and SIGHUP do not end the program but are remembered, the first of them: a run then stops
// after the pass at hand and writes what it has. A second one ends the program at once. One at a time.
class StopOnSignal {
 public:
    StopOnSignal();
    ~StopOnSignal();
    StopOnSignal(const StopOnSignal&) = delete;
    StopOnSignal& operator=(const StopOnSignal&) = delete;
};

// The signal that came, 0 = none.
int stop_signal();

// The exit code that shells expect of what a signal ended.
inline int exit_code_of_signal(int signal) { return 128 + signal; }

// "SIGINT" and the like.
const char* name_of_signal(int signal);

}  // namespace trocar
