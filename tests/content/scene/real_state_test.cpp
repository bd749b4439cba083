#include <fstream>
#include <sstream>

#include "content/mend/admission.hpp"
#include "engine/base/disjoint_sets.hpp"
#include "engine/geometry/edge_table.hpp"
#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

// One row of the table beside the real surfaces, counted by an independent program.
struct Row {
    std::string file, state;
    unsigned vertices = 0, triangles = 0, boundary = 0, non_manifold = 0, flipped = 0, pieces = 0, degenerate = 0, duplicate = 0;
    int euler = 0;
    double volume = 0;
};

std::vector<std::string> cells_of(const std::string& line) {
    std::vector<std::string> cells;
    std::stringstream stream(line);
    for (std::string cell; std::getline(stream, cell, '|');) {
        const size_t first = cell.find_first_not_of(' ');
        cells.push_back(first == std::string::npos ? "" : cell.substr(first, cell.find_last_not_of(' ') + 1 - first));
    }
    return cells;
}

std::vector<Row> read_table(const std::filesystem::path& data) {
    std::vector<Row> rows;
    std::ifstream stream(data / "README.md");
    for (std::string line; std::getline(stream, line);) {
        const std::vector<std::string> cell = cells_of(line);
        Row row;
        if (cell.size() < 10 || std::sscanf(cell[2].c_str(), "V=%u F=%u", &row.vertices, &row.triangles) != 2) continue;
        row.file = cell[1];
        row.state = cell[3];
        const bool whole =
            std::sscanf(cell[4].c_str(), "boundary %u nonman %u flipped %u", &row.boundary, &row.non_manifold, &row.flipped) == 3 &&
            std::sscanf(cell[5].c_str(), "comps %u", &row.pieces) == 1 && std::sscanf(cell[6].c_str(), "chi %d", &row.euler) == 1 &&
            std::sscanf(cell[8].c_str(), "degen %u dup %u", &row.degenerate, &row.duplicate) == 2 &&
            std::sscanf(cell[9].c_str(), "vol %lg", &row.volume) == 1;
        EXPECT_TRUE(whole) << line;
        rows.push_back(row);
    }
    return rows;
}

// Pieces connected at vertices; judge_mesh counts pieces connected across edges.
uint32_t pieces_by_vertex(const Mesh& mesh) {
    std::vector<uint32_t> sets = make_sets(static_cast<uint32_t>(mesh.position.size()));
    for (const Triangle& t : mesh.triangle) {
        join_sets(sets, t[0], t[1]);
        join_sets(sets, t[0], t[2]);
    }
    uint32_t pieces = 0;
    for (uint32_t v = 0; v < sets.size(); ++v) pieces += find_set(sets, v) == v;
    return pieces;
}

TEST(RealState, every_surface_is_judged_as_the_table_says) {
    const std::filesystem::path data = shared_data_folder();
    if (data.empty()) GTEST_SKIP() << "the folder of real surfaces is absent";
    const std::vector<Row> rows = read_table(data);
    EXPECT_GE(rows.size(), 23u);
    for (const Row& row : rows) {
        SCOPED_TRACE(row.file);
        const Mesh mesh = load_mesh(data / row.file).mesh;
        const MeshJudgement judged = judge_mesh(mesh, false);
        EXPECT_EQ(judged.vertices, row.vertices);
        EXPECT_EQ(judged.triangles, row.triangles);
        EXPECT_EQ(judged.boundary_edges, row.boundary);
        EXPECT_EQ(judged.non_manifold_edges, row.non_manifold);
        EXPECT_EQ(judged.flipped_edges, row.flipped);
        EXPECT_EQ(judged.degenerate, row.degenerate);
        EXPECT_EQ(judged.duplicate, row.duplicate);
        EXPECT_EQ(pieces_by_vertex(mesh), row.pieces);
        EXPECT_EQ(judged.closed, row.state != "OPEN");
        EXPECT_EQ(judged.closed && judged.manifold && judged.oriented, row.state == "closed manifold");
        EXPECT_NEAR(judged.volume, row.volume, 6e-5 * std::abs(row.volume));  // five digits
        const EdgeTable table = make_edge_table(mesh.triangle, judged.vertices);
        EXPECT_EQ(static_cast<int>(judged.vertices) - static_cast<int>(table.edge.size()) + static_cast<int>(judged.triangles), row.euler);
    }
}

}  // namespace
}  // namespace trocar
