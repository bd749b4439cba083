#pragma once
#include <string>
namespace trocar {

// A progress line on standard error for long jobs; silent if that is not a terminal.
class Progress {
 public:
    explicit Progress(std::string title);
    ~Progress();
    // done in [0, 1]; redraws at most ten times a second.
    void show(double done, const std::string& note);

 private:
    std::string title_;
    bool terminal_ = false;
    unsigned long long start_ns_ = 0, shown_ns_ = 0;
};

}  // namespace trocar
