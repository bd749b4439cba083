#pragma once
#include <array>
#include <string>
#include <vector>

#include "systems/frame/frame.hpp"
namespace trocar {

// Energy of a scene against what entered it: what it had at the start, what hands, scripts and new links brought, and
// the height lost. While bodies that started inside each other still are, the work of parting them enters, too, up to what
// straining the smaller one by the overlap and lifting it takes; so does what comes back into a pool of bodies.
struct EnergyBudget {
    bool known = false;
    double start = 0, start_gravity = 0, least_gravity = 0;  // J
    double noise = 0;                                        // J, that rounding makes
    double hand = 0, links = 0;                              // J, the most so far
    double parting = 0;                                      // J
    double entered() const { return start + hand + links + parting + (start_gravity - least_gravity); }
};

// Two bodies that are inside each other.
struct LastingOverlap {
    std::array<uint32_t, 2> pair{};
    double depth = 0, share = 0;  // m, of the smaller body's size
    uint64_t since = 0;           // tick
};

// Looks after each pass for what a scene cannot mean or a simulation must not do: counts it in the world's report and
// warns, naming a body or tool, once for each kind of trouble.
class RunWatch {
 public:
    // Before the first pass.
    explicit RunWatch(const World& world);
    void after_pass(Frame& frame);
    // Gravity was changed between two passes, which lifted all bodies by so much potential energy, J.
    void shift_gravity(double gained) { budget_.start_gravity += gained, budget_.least_gravity += gained; }
    // After the last one.
    void finish(World& world);
    // What was not yet taken.
    std::vector<std::string> take_warnings();
    // Why the run has no value; empty = it has.
    const std::string& ruin() const { return ruin_; }
    const EnergyBudget& budget() const { return budget_; }
    // Whether it warned of short steps.
    bool is_slow() const { return short_; }

 private:
    void look_at_start(World& world);
    void look_at_energy(Frame& frame);
    void warn_of_energy(World& world);
    void look_at_tools(const World& world);
    void look_at_passed_surfaces(const World& world);
    void look_at_tetrahedra(const World& world);
    void look_at_crossings(const World& world);
    void count_crossings_at_end(World& world);
    void look_at_steps(const World& world);
    void look_at_unswept(const World& world);
    void follow_overlaps(const World& world);

    std::vector<std::string> warnings_;
    std::string ruin_;
    EnergyBudget budget_;
    std::vector<LastingOverlap> overlapping_;
    std::vector<std::array<uint32_t, 2>> parting_;  // pairs that started inside each other and still are
    double push_ = 0, numeric_ = 0;                 // J, works after the last pass and picture
    double parting_left_ = 0;                       // J, that parting may still take
    double worst_unearned_ = 0;                     // J
    std::string worst_text_;
    std::vector<uint8_t> inverted_;      // per body: warned of
    std::vector<uint8_t> passed_;        // per tool: warned of
    std::vector<uint32_t> tool_inside_;  // per tool: the body that it is inside, or kNone
    uint64_t inverted_before_ = 0, unswept_before_ = 0;
    bool unswept_ = false, short_ = false, unearned_ = false, crossed_ = false;
};

}  // namespace trocar
