#include "engine/jobs/job_graph.hpp"

#include <tbb/flow_graph.h>

#include <deque>

#include "engine/jobs/race_detector.hpp"
#include "engine/jobs/thread_pool.hpp"
namespace trocar {
namespace {

void run_stage(const Stage& stage, uint32_t index, FrameState& state, const StageObserver& observer) {
    if (observer.begin) observer.begin(observer.user, index);
    stage.run(state);
    if (observer.end) observer.end(observer.user, index);
}

}  // namespace

std::vector<std::pair<uint32_t, uint32_t>> stage_edges(std::span<const Stage> stages) {
    std::vector<std::pair<uint32_t, uint32_t>> edges;
    for (uint32_t b = 0; b < stages.size(); ++b) {
        for (uint32_t a = 0; a < b; ++a) {
            const ResourceMask touched_b = stages[b].reads | stages[b].writes;
            if ((stages[a].writes & touched_b) | (stages[a].reads & stages[b].writes)) edges.emplace_back(a, b);
        }
    }
    return edges;
}

void run_serial(std::span<const Stage> stages, FrameState& state, const StageObserver& observer) {
    for (uint32_t i = 0; i < stages.size(); ++i) run_stage(stages[i], i, state, observer);
}

struct JobGraph::Impl {
    using Node = tbb::flow::continue_node<tbb::flow::continue_msg>;
    std::vector<Stage> stages;
    FrameState* state = nullptr;
    StageObserver observer;
    tbb::flow::graph graph;
    std::deque<Node> nodes;
    std::vector<uint32_t> first;  // indices of nodes without predecessors
    // for the thread sanitizer, which does not see inside the scheduler
    std::vector<std::vector<uint32_t>> before;  // per node: indices of its predecessors
    std::vector<char> done;                     // per node: token of its completion
    char begun = 0;

    void run_node(uint32_t index) TROCAR_NO_RACE_DETECTION {
        take_over(&begun);
        for (const uint32_t earlier : before[index]) take_over(&done[earlier]);
        run_stage(stages[index], index, *state, observer);
        hand_over(&done[index]);
    }
};

JobGraph::JobGraph(std::span<const Stage> stages, FrameState& state, const StageObserver& observer) : impl_(new Impl) {
    impl_->stages.assign(stages.begin(), stages.end());
    impl_->state = &state;
    impl_->observer = observer;
    impl_->before.resize(stages.size());
    impl_->done.resize(stages.size());
    for (uint32_t i = 0; i < stages.size(); ++i) {
        impl_->nodes.emplace_back(impl_->graph,
                                  [impl = impl_.get(), i](const tbb::flow::continue_msg&) TROCAR_NO_RACE_DETECTION { impl->run_node(i); });
    }
    for (const auto& [a, b] : stage_edges(stages)) {
        tbb::flow::make_edge(impl_->nodes[a], impl_->nodes[b]);
        impl_->before[b].push_back(a);
    }
    for (uint32_t i = 0; i < stages.size(); ++i) {
        if (impl_->before[i].empty()) impl_->first.push_back(i);
    }
}

JobGraph::~JobGraph() = default;

void JobGraph::run() {
    // one thread: the list itself is a valid order and costs nothing to schedule
    if (thread_count() <= 1) {
        run_serial(impl_->stages, *impl_->state, impl_->observer);
        return;
    }
    hand_over(&impl_->begun);
    for (const uint32_t i : impl_->first) impl_->nodes[i].try_put(tbb::flow::continue_msg());
    impl_->graph.wait_for_all();
    for (const char& ran : impl_->done) take_over(&ran);
}

}  // namespace trocar
