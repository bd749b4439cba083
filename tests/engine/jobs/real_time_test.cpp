#include "engine/jobs/real_time.hpp"

#include <gtest/gtest.h>
#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <random>
#include <thread>
#include <vector>
namespace trocar {
namespace {

// ---- histogram ----

// Against the sorted values; breaks when a bin's bounds or the rank are off.
TEST(TimeHistogram, PercentilesAreExactToABin) {
    std::mt19937_64 random(1);
    std::lognormal_distribution<double> spread(13, 2);
    auto histogram = std::make_unique<TimeHistogram>();
    std::vector<int64_t> values;
    double sum = 0;
    for (int k = 0; k < 20'000; ++k) {
        values.push_back(static_cast<int64_t>(spread(random)));
        histogram->add(values.back());
        sum += static_cast<double>(values.back());
    }
    std::sort(values.begin(), values.end());
    for (const double q : {0.0, 0.001, 0.5, 0.9, 0.99, 0.999, 1.0}) {
        const size_t rank = std::max<size_t>(1, static_cast<size_t>(std::ceil(q * double(values.size()))));
        const int64_t exact = values[rank - 1], found = histogram->percentile(q);
        EXPECT_GE(found, exact) << q;
        EXPECT_LE(double(found), double(exact) * (1 + 1.0 / 64) + 1) << q;
    }
    EXPECT_EQ(histogram->percentile(1), values.back());
    EXPECT_EQ(histogram->smallest, values.front());
    EXPECT_EQ(histogram->count, values.size());
    EXPECT_NEAR(histogram->mean(), sum / double(values.size()), 1e-6 * histogram->mean());
}

TEST(TimeHistogram, EdgesOfItsRange) {
    auto histogram = std::make_unique<TimeHistogram>();
    EXPECT_EQ(histogram->percentile(0.5), 0);
    histogram->add(-5);
    EXPECT_EQ(histogram->percentile(1), 0);
    for (int64_t ns = 0; ns < 64; ++ns) {
        *histogram = {};
        histogram->add(ns);
        histogram->add(ns + 1'000'000);
        EXPECT_EQ(histogram->percentile(0.5), ns);  // small values have bins of their own
    }
    // every power of two and its neighbours are in a bin whose range contains them
    for (int bit = 6; bit < 62; ++bit) {
        for (const int64_t ns : {(int64_t{1} << bit) - 1, int64_t{1} << bit, (int64_t{1} << bit) + 1}) {
            *histogram = {};
            histogram->add(ns);
            histogram->add(INT64_MAX / 2);
            EXPECT_GE(histogram->percentile(0.5), std::min(ns, int64_t{1} << 47)) << ns;
        }
    }
}

// ---- clock and thread ----

TEST(RealTime, SleepNeverWakesBeforeTheDeadline) {
    for (int k = 0; k < 20; ++k) {
        const int64_t deadline = monotonic_ns() + 500'000;
        sleep_until_ns(deadline);
        EXPECT_GE(monotonic_ns(), deadline);
    }
    const int64_t before = monotonic_ns();
    sleep_until_ns(before - 1'000'000'000);  // passed: no sleep, no error
    EXPECT_GE(monotonic_ns(), before);
}

// Indices identify deadlines: run k never starts before start + k * period, indices ascend, and every skipped
// index counts as missed. True however busy the machine is.
TEST(RealTime, PeriodicRunsKeepToAbsoluteDeadlines) {
    PeriodicThread thread;
    PeriodicOptions options;
    options.period = 2'000'000;
    options.real_time = false;
    const int64_t start = monotonic_ns() + 5'000'000;
    std::vector<uint64_t> index;
    std::vector<int64_t> begin;
    thread.start(options, start, [&](uint64_t k, int64_t at) {
        index.push_back(k);
        begin.push_back(at);
        // one run is too long on purpose
        if (index.size() == 10) sleep_until_ns(at + 7'000'000);
    });
    EXPECT_TRUE(thread.running());
    sleep_until_ns(start + 100'000'000);
    thread.stop();
    EXPECT_FALSE(thread.running());
    ASSERT_GT(index.size(), 12u);
    for (size_t k = 0; k < index.size(); ++k) {
        EXPECT_GE(begin[k], start + static_cast<int64_t>(index[k]) * options.period);
        if (k > 0) {
            EXPECT_GT(index[k], index[k - 1]);
        }
    }
    EXPECT_GE(index[10], index[9] + 4);  // 7 ms later is past three more deadlines
    const PeriodicFigures& f = thread.figures();
    // (runs skipped at the very end are counted but not observed)
    EXPECT_GE(f.missed, index.back() + 1 - index.size());
    EXPECT_GE(f.missed, 3u);
    uint64_t doubled = 0;  // recomputed from the starts: the long run counts once, though three deadlines passed in it
    for (size_t k = 1; k < begin.size(); ++k) doubled += begin[k] - begin[k - 1] > 4'000'000;
    EXPECT_EQ(f.doubled, doubled);
    EXPECT_GE(f.doubled, 1u);
    EXPECT_EQ(f.late.count, index.size());
    EXPECT_EQ(f.period.count, index.size() - 1);
    EXPECT_GE(f.compute.largest, 7'000'000);
}

// The reported grant is the actual one: querying the thread's policy gives the same.
TEST(RealTime, GrantSaysWhatTheThreadGot) {
    PeriodicThread thread;
    int policy = -1;
    sched_param got{};
    PeriodicOptions options;
    options.priority = 7;
    thread.start(options, monotonic_ns(), [&](uint64_t, int64_t) {
        // query the kernel: the C library remembers what it set itself
        policy = sched_getscheduler(0) & ~SCHED_RESET_ON_FORK;
        sched_getparam(0, &got);
    });
    sleep_until_ns(monotonic_ns() + 20'000'000);
    thread.stop();
    const RealTimeGrant& grant = thread.figures().grant;
    EXPECT_EQ(grant.fifo, policy == SCHED_FIFO);
    if (grant.fifo) {
        EXPECT_EQ(got.sched_priority, 7);
    }
    const std::string text = describe(grant);
    EXPECT_EQ(text.find("SCHED_FIFO 7") != std::string::npos, grant.fifo);
    EXPECT_NE(text.find(kernel_name()), std::string::npos);
    EXPECT_EQ(kernel_name().rfind("Linux ", 0), 0u);
}

// Runs that change threads follow each other and see all that the preceding one wrote (plain variables,
// checked by the thread sanitizer), and each deadline has one run or counts as missed.
TEST(RealTime, RunsOnTwoProcessorsAreOneAfterTheOther) {
    const std::vector<int> allowed = allowed_processors();
    ASSERT_FALSE(allowed.empty());
    PeriodicThread thread;
    PeriodicOptions options;
    options.period = 200'000;
    options.real_time = false;
    options.processors = 2;
    const int64_t start = monotonic_ns() + 5'000'000;
    std::vector<uint64_t> index;
    uint64_t elsewhere = 0;
    std::atomic<int> at_work{0}, most_at_work{0};
    thread.start(options, start, [&](uint64_t k, int64_t at) {
        most_at_work = std::max(most_at_work.load(), ++at_work);
        index.push_back(k);
        elsewhere += sched_getcpu() != allowed[0];
        if (k % 7 == 0) sleep_until_ns(at + 500'000);  // the other wakes meanwhile
        --at_work;
    });
    sleep_until_ns(start + 300'000'000);
    thread.stop();
    EXPECT_EQ(most_at_work, 1);
    ASSERT_GT(index.size(), 50u);
    for (size_t k = 1; k < index.size(); ++k) EXPECT_GT(index[k], index[k - 1]);
    const PeriodicFigures& f = thread.figures();
    EXPECT_GE(f.missed + f.compute.count, index.back() + 1);  // some are skipped after the last
    EXPECT_EQ(f.compute.count, index.size());
    if (f.grant.processors < 2) GTEST_SKIP() << "one processor here";
    EXPECT_EQ(f.relieved, elsewhere);  // threads stay on their processors
}

// Figures of a thread while a higher-priority thread occupies one of its two processors for that time.
// `granted`: whether there was such a thread.
PeriodicFigures run_held_up(int64_t held_up, bool& granted) {
    PeriodicThread thread;
    PeriodicOptions options;
    options.priority = 10;
    options.processors = 2;
    thread.start(options, monotonic_ns(), [](uint64_t, int64_t) {});
    const std::vector<int> allowed = allowed_processors();
    std::thread hog([&] {
        allow_processors(std::span(allowed).first(1));
        granted = request_real_time(20, false).fifo;
        const int64_t until = monotonic_ns() + held_up;
        while (granted && monotonic_ns() < until) {
        }
    });
    hog.join();
    thread.stop();
    return thread.figures();
}

// Threads bound to their processors cannot leave one that is occupied for 0.2 s; the runs continue on the
// other. The host of a crowded virtual machine may stop that one as well, but not in every one of several
// attempts.
TEST(RealTime, OneProcessorHeldUpIsRelievedByTheOther) {
    const int64_t held_up = 200'000'000;
    bool relieved = false;
    for (int attempt = 0; attempt < 10 && !relieved; ++attempt) {
        bool granted = false;
        const PeriodicFigures f = run_held_up(held_up, granted);
        EXPECT_NE(f.grant.processors > 1, describe(f.grant).find(" processors") == std::string::npos);
        if (!granted) GTEST_SKIP() << "SCHED_FIFO is not granted here";
        if (f.grant.processors < 2) GTEST_SKIP() << "one processor here";
        relieved = f.period.largest < held_up / 2 && f.relieved > 0;
    }
    EXPECT_TRUE(relieved);
}

TEST(RealTime, ThreadCanBeStartedAgain) {
    PeriodicThread thread;
    PeriodicOptions options;
    options.real_time = false;
    for (int round = 0; round < 3; ++round) {
        std::atomic<int> runs{0};
        thread.start(options, monotonic_ns(), [&](uint64_t, int64_t) { ++runs; });
        while (runs.load() < 3) sleep_until_ns(monotonic_ns() + 1'000'000);
        thread.stop();
        EXPECT_EQ(thread.figures().compute.count, static_cast<uint64_t>(runs.load()));
    }
}

}  // namespace
}  // namespace trocar
