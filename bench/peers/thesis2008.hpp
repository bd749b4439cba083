#pragma once
#include <map>
#include <unordered_map>

#include "bench/peers/signed_distance.hpp"
namespace trocar::bench {

// One vertex inside the other body of a pair (thesis 4.1.1, 4.2).
struct ThesisVertex {
    uint32_t vertex = 0;  // index in the soup
    uint32_t body = 0;
    double distance = 0;   // m, shortest distance to the other surface, > 0
    double projected = 0;  // m, on the direction of the pair
};
struct ThesisPair {
    std::array<uint32_t, 2> bodies{};
    std::vector<ThesisVertex> inside;
    double depth = 0;                // m, largest of the shortest distances
    Vec<double> direction{0, 0, 0};  // of that one: the single direction of the pair
};

// R. Pavithran's collision detection of 2008 (chapters 3.3 and 4), reimplemented from the text, with its
// containers: cells in a hash table, the objects of a cell in a search tree, their triangles in a vector.
// Candidates are only the vertices of triangles in potential collision cells; closest points are searched
// among the other object's triangles of those cells; one direction per pair, distances projected on it.
// Distances in double, so that the errors are the method's.
class Thesis2008 {
 public:
    explicit Thesis2008(const Soup& soup) : incidence_(soup) {}
    void run(const Soup& soup, double cell_size, std::vector<ThesisPair>& pairs);

 private:
    struct Count {
        uint32_t objects = 0, last = kNone;
    };
    template <typename Visit>
    void rasterise(const Soup& soup, uint32_t triangle, const Visit& visit) const;
    void construct(const Soup& soup);
    void find_overlap(const Soup& soup, const std::vector<uint64_t>& cells, ThesisPair& pair);

    Incidence incidence_;
    Vec<double> origin_{};
    double cell_size_ = 1;
    std::unordered_map<uint64_t, Count> counting_;
    std::unordered_map<uint64_t, std::map<uint32_t, std::vector<uint32_t>>> cells_;
};

}  // namespace trocar::bench
