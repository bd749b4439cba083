#pragma once
#include "engine/capture_file.hpp"
#include "systems/app/figures.hpp"
#include "systems/frame.hpp"
namespace trocar {

// Watches a lockstep run for its deepest overlap and keeps the state before that pass, so that the pass can be run again
// with the other direction of the response.
class DirectionTrial {
 public:
    explicit DirectionTrial(const Frame& frame) : frame_(frame) {}
    void before_pass();
    void after_pass(const PassFigures& pass);
    // From the state kept: the pass with `response.direction` thesis and local, and what each leaves. Nothing when no
    // state was kept. Inside ThreadPool::run.
    DirectionFigures run() const;

 private:
    World start() const;  // before the deepest pass
    const Frame& frame_;
    CaptureRecord state_, deepest_;
    double depth_before_ = 0, record_ = 0;  // m, of the pass before, of the deepest
};

}  // namespace trocar
