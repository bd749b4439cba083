#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>

#include "engine/files/image_file.hpp"
#include "tests/app/run_program.hpp"

// The program from the user's point of view: exit codes, one-line errors that name the position, no partial
// files.
namespace {
namespace fs = std::filesystem;
using trocar::Outcome;

class CommandLine : public testing::Test {
 protected:
    void SetUp() override {
        const auto* info = testing::UnitTest::GetInstance()->current_test_info();
        folder_ = fs::path(testing::TempDir()) / (std::string("trocar_") + info->name());
        fs::remove_all(folder_);
        fs::create_directories(folder_);
    }
    void TearDown() override { fs::remove_all(folder_); }

    Outcome run(const std::string& arguments) const { return trocar::run_program(arguments, trocar::source_folder(), folder_); }
    fs::path write(const std::string& name, const std::string& text) const {
        std::ofstream(folder_ / name) << text;
        return folder_ / name;
    }
    static std::string cube(double size = 1) {
        std::ostringstream obj;
        for (int i = 0; i < 8; ++i) obj << "v " << (i & 1) * size << " " << (i >> 1 & 1) * size << " " << (i >> 2 & 1) * size << "\n";
        obj << "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
        return obj.str();
    }
    static void expect_one_line(const std::string& text) { EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text; }
    fs::path folder_;
};

// A scene is built and not run; an error is reported with its line.
TEST_F(CommandLine, CheckNamesTheWrongLineOfAScene) {
    const std::string scene = "[[body]]\nname = \"floor\"\nshape = \"box\"\ntriangles = 12\n[body.haptic]\nstatic_friction = ";
    const Outcome good = run("check " + write("good.toml", scene + "0.2\n").string());
    EXPECT_EQ(good.code, 0) << good.err;
    EXPECT_NE(good.out.find("a sound scene of 1 bodies"), std::string::npos) << good.out;
    const Outcome bad = run("check " + write("bad.toml", scene + "-0.2\n").string());
    EXPECT_EQ(bad.code, 2);
    EXPECT_NE(bad.err.find("bad.toml:6:"), std::string::npos) << bad.err;
    expect_one_line(bad.err);
}

// Two balls of 50 mm with centres 10 mm apart are reported as overlapping at the start, with the depth; at 48
// mm (2 mm deep) the overlap may be intended. Breaks when scripted poses are not applied yet (the rod starts
// far away), or all pairs are reported.
TEST_F(CommandLine, DeepStartsAreTold) {
    const auto ball = [](const std::string& name, const char* x) {
        return "[[body]]\nname = \"" + name + "\"\nshape = \"sphere\"\nsize = 0.05\ntriangles = 320\nmotion = \"free\"\nposition = [" + x +
               ", 0.0, 0.0]\n";
    };
    const std::string rod =
        "[[body]]\nname = \"rod\"\nshape = \"sphere\"\nsize = 0.05\ntriangles = 320\nmotion = \"kinematic\"\n"
        "[[body.path]]\ntime = 0.0\nposition = [1.0, 0.0, 0.0]\n";
    const Outcome deep =
        run("run " + write("deep.toml", ball("a", "0.0") + ball("b", "0.01") + rod).string() + " --seconds 0.02 --no-render");
    EXPECT_EQ(deep.code, 0);
    expect_one_line(deep.err);
    EXPECT_NE(deep.err.find("\"a\" and \"b\" start 9.8"), std::string::npos) << deep.err;
    EXPECT_EQ(run("run " + write("touch.toml", ball("a", "0.0") + ball("b", "0.048") + rod).string() + " --seconds 0.02 --no-render").err,
              "");
}

// In a live run the instrument in the hand is exchanged for another with a point shell; the recording replays
// bit for bit. The instrument comes down three times: if the machine stalled meanwhile, it starts inside and
// feels nothing until it has left.
TEST_F(CommandLine, ALiveRunExchangesShells) {
    const auto ball = [](const std::string& name, const char* size) {
        return "[[body]]\nname = \"" + name + "\"\nshape = \"sphere\"\nsize = " + size + "\ntriangles = 320\nmotion = \"hand\"\n";
    };
    const auto key = [](const char* time, const char* height) {
        return std::string("[[tool.path]]\ntime = ") + time + "\nposition = [0.0, 0.0, " + height + "]\n";
    };
    const std::string scene =
        "seconds = 2.4\n[[body]]\nname = \"floor\"\nshape = \"box\"\nsize = 1.0\ntriangles = 12\nposition = [0.0, 0.0, -0.5]\n" +
        ball("small", "0.02") + ball("large", "0.04") +
        "[[tool]]\nbody = \"small\"\ndof = 6\npoints = 200\nstiffness = 600.0\n[[tool.exchange]]\nbody = \"large\"\ntime = 0.6\n" +
        key("0.0", "0.03") + key("0.2", "0.009") + key("0.4", "0.009") + key("0.55", "0.03") + key("0.8", "0.0215") + key("1.1", "0.018") +
        key("1.3", "0.0215") + key("1.7", "0.018") + key("1.9", "0.0215") + key("2.3", "0.018");
    const std::string file = write("exchange.toml", scene).string(), out = (folder_ / "live").string();
    const Outcome live = run("run " + file + " --live --no-render --out " + out);
    ASSERT_EQ(live.code, 0) << live.err;
    std::ifstream table(out + "/tools.csv");
    double most[2] = {0, 0};  // N, of each instrument, upward
    for (std::string line; std::getline(table, line);) {
        std::vector<std::string> cell(1);
        for (const char c : line) {
            if (c == ',')
                cell.emplace_back();
            else
                cell.back().push_back(c);
        }
        if (cell[1] == "small" || cell[1] == "large") most[cell[1] == "large"] = std::max(most[cell[1] == "large"], std::stod(cell[10]));
    }
    EXPECT_GT(most[0], 0.3) << "1 mm deep";
    EXPECT_GT(most[1], 0.6) << "2 mm deep";
    EXPECT_EQ(run("run " + file + " --no-render --replay " + out + "/live.recording").code, 0);
}

TEST_F(CommandLine, HelpTeachesAndEveryCommandHasAnExample) {
    EXPECT_EQ(run("--help").code, 0);
    for (const char* command : {"run", "check", "query", "collide", "convert", "view", "organ", "scenes"}) {
        const Outcome help = run(std::string(command) + " --help");
        EXPECT_EQ(help.code, 0);
        EXPECT_NE(help.out.find("Example:"), std::string::npos) << command;
    }
}

TEST_F(CommandLine, VersionNamesLibrariesAndInstructionSet) {
    const Outcome version = run("--version");
    EXPECT_EQ(version.code, 0);
    EXPECT_NE(version.out.find("Embree 3.13"), std::string::npos) << version.out;
    EXPECT_NE(version.out.find("avx"), std::string::npos) << version.out;
}

TEST_F(CommandLine, UsageErrorsExitWithTwo) {
    const Outcome bare = run("");  // no error: lists the commands
    EXPECT_EQ(bare.code, 0);
    EXPECT_NE(bare.out.find("collide"), std::string::npos) << bare.out;
    EXPECT_EQ(run("fly").code, 2);
    EXPECT_EQ(run("run").code, 2);
    EXPECT_EQ(run("collide a.obj").code, 2);
}

// OSMesa is loaded with the first picture. Breaks when the program is linked against it: then nothing starts
// here.
TEST_F(CommandLine, OnlyPicturesNeedOSMesa) {
    write("libOSMesa.so.8", "no library");
    const char* before = getenv("LD_LIBRARY_PATH");
    const std::string restored = before ? before : "";
    setenv("LD_LIBRARY_PATH", folder_.c_str(), 1);
    const Outcome without = run("run rigid_stack --seconds 0.02 --no-render"),
                  with = run("run rigid_stack --seconds 0.02 --out " + (folder_ / "drawn").string());
    before ? setenv("LD_LIBRARY_PATH", restored.c_str(), 1) : unsetenv("LD_LIBRARY_PATH");
    EXPECT_EQ(without.code, 0) << without.err;
    EXPECT_EQ(with.code, 2);
    expect_one_line(with.err);
    EXPECT_NE(with.err.find("pictures need OSMesa (package libosmesa6): "), std::string::npos) << with.err;
}

TEST_F(CommandLine, MissingFilesAreNamed) {
    for (const std::string& arguments :
         {std::string("check nowhere.obj"), std::string("run nowhere.toml"), std::string("query nowhere.obj p.csv"),
          std::string("collide nowhere.obj b.obj"), std::string("convert nowhere.obj b.obj")}) {
        const Outcome outcome = run(arguments);
        EXPECT_EQ(outcome.code, 2) << arguments;
        EXPECT_NE(outcome.err.find("nowhere"), std::string::npos) << outcome.err;
        expect_one_line(outcome.err);
    }
}

TEST_F(CommandLine, UnknownKeySuggestsTheNearestWithLineAndColumn) {
    const fs::path scene = write("s.toml", "name = \"x\"\n[[body]]\nname = \"a\"\nshape = \"box\"\nmotoin = \"static\"\n");
    const Outcome outcome = run("run " + scene.string());
    EXPECT_EQ(outcome.code, 2);
    EXPECT_NE(outcome.err.find(":5:1:"), std::string::npos) << outcome.err;
    EXPECT_NE(outcome.err.find("did you mean \"motion\""), std::string::npos) << outcome.err;
    expect_one_line(outcome.err);
}

TEST_F(CommandLine, WrongTypeNamesLineAndColumn) {
    const fs::path scene = write("s.toml", "seconds = \"long\"\n");
    const Outcome outcome = run("run " + scene.string());
    EXPECT_EQ(outcome.code, 2);
    EXPECT_NE(outcome.err.find("s.toml:1:11: seconds must be a number"), std::string::npos) << outcome.err;
}

TEST_F(CommandLine, SceneCutInHalfNamesItsLine) {
    const fs::path scene = write("s.toml", "name = \"x\"\n[[body]]\nname = \"a");
    const Outcome outcome = run("run " + scene.string());
    EXPECT_EQ(outcome.code, 2);
    EXPECT_NE(outcome.err.find("s.toml:3"), std::string::npos) << outcome.err;
    expect_one_line(outcome.err);
}

TEST_F(CommandLine, SetOfAnUnknownBodyIsRefused) {
    const Outcome outcome = run("run probe_on_liver --seconds 0.1 --set spleen.triangles=100");
    EXPECT_EQ(outcome.code, 2);
    EXPECT_NE(outcome.err.find("spleen"), std::string::npos);
}

TEST_F(CommandLine, MeshCutInHalfIsRefusedWithItsPlace) {
    const fs::path whole = write("whole.obj", cube());
    ASSERT_EQ(run("convert " + whole.string() + " " + (folder_ / "cube.stl").string()).code, 0);
    ASSERT_EQ(run("convert " + whole.string() + " " + (folder_ / "cube.wrl").string()).code, 0);
    fs::resize_file(folder_ / "cube.stl", fs::file_size(folder_ / "cube.stl") / 2);
    fs::resize_file(folder_ / "cube.wrl", fs::file_size(folder_ / "cube.wrl") / 2);
    for (const char* name : {"cube.stl", "cube.wrl"}) {
        const Outcome outcome = run("check " + (folder_ / name).string());
        EXPECT_EQ(outcome.code, 2) << name;
        EXPECT_NE(outcome.err.find(name), std::string::npos) << outcome.err;
        expect_one_line(outcome.err);
    }
}

TEST_F(CommandLine, FullDiskAndUnwritableFolderLeaveNothingBehind) {
    const fs::path whole = write("whole.obj", cube()), points = write("p.csv", "x,y,z\n0.5,0.5,0.5\n");
    const Outcome full = run("query " + whole.string() + " " + points.string() + " --out /dev/full");
    EXPECT_EQ(full.code, 2);
    EXPECT_NE(full.err.find("/dev/full"), std::string::npos) << full.err;
    const Outcome stdout_full = run("query " + whole.string() + " " + points.string() + " >/dev/full");
    EXPECT_EQ(stdout_full.code, 2) << stdout_full.err;
    const Outcome folder = run("run probe_on_liver --seconds 0.1 --out /proc/nothing");
    EXPECT_EQ(folder.code, 2);
    EXPECT_NE(folder.err.find("/proc/nothing"), std::string::npos) << folder.err;
    expect_one_line(folder.err);
    const Outcome convert = run("convert " + whole.string() + " " + (folder_ / "absent/x.obj").string());
    EXPECT_EQ(convert.code, 2);
    EXPECT_FALSE(fs::exists(folder_ / "absent"));
}

TEST_F(CommandLine, CheckNamesItsFields) {
    const fs::path whole = write("whole.obj", cube(2));
    const Outcome outcome = run("check --json " + whole.string());
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const nlohmann::json j = nlohmann::json::parse(outcome.out);
    EXPECT_EQ(j["vertices"], 8);
    EXPECT_EQ(j["triangles"], 12);
    EXPECT_TRUE(j["closed"] && j["manifold"] && j["oriented"]);
    EXPECT_EQ(j["components"], 1);
    EXPECT_EQ(j["degenerate"], 0);
    EXPECT_DOUBLE_EQ(j["volume"], 8);
    EXPECT_DOUBLE_EQ(j["area"], 24);
    EXPECT_EQ(j["bbox_min"], nlohmann::json({0.0, 0.0, 0.0}));
    EXPECT_EQ(j["bbox_max"], nlohmann::json({2.0, 2.0, 2.0}));
    EXPECT_EQ(j["admitted_as"], "solid");
    EXPECT_TRUE(j.contains("reason") && j.contains("file"));
}

// An open box with one face duplicated and reversed: changes made by the import are listed, and --repair
// closes what the import cannot.
TEST_F(CommandLine, RepairSaysWhatItDidAndRefusesWhatItCannotDo) {
    std::string text = cube(30);
    text.replace(text.find("f 1 3 4 2"), 9, "f 5 8 6");
    const fs::path open = write("open.obj", text), out = folder_ / "out.obj";
    const Outcome check = run("check --json " + open.string());
    EXPECT_EQ(check.code, 1);
    const nlohmann::json j = nlohmann::json::parse(check.out);
    EXPECT_EQ(j["boundary_edges"], 4);
    EXPECT_EQ(j["duplicate_faces"], 1);
    EXPECT_TRUE(j.contains("non_manifold_edges") && j.contains("flipped_edges") && j.contains("self_crossing"));
    EXPECT_EQ(j["repairs"], nlohmann::json({"1 opposite doubled face dropped", "1 face turned to agree"}));
    EXPECT_EQ(j["unit_guess"], "mm");
    EXPECT_NE(j["unit_rule"].get<std::string>().find("diagonal 51.96"), std::string::npos);

    const Outcome refused = run("convert --repair " + open.string() + " " + out.string());
    EXPECT_EQ(refused.code, 1);
    EXPECT_FALSE(fs::exists(out));
    EXPECT_NE(refused.err.find("cannot be repaired: open: 4 boundary edges; 1 hole"), std::string::npos) << refused.err;

    const Outcome done = run("convert --repair --hole-size 1 " + open.string() + " " + out.string());
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_NE(done.out.find("1 hole filled with 2 faces"), std::string::npos) << done.out;
    const Outcome again = run("check --json " + out.string());
    EXPECT_EQ(again.code, 0);
    EXPECT_DOUBLE_EQ(nlohmann::json::parse(again.out)["volume"], 27000);
}

// A world that takes its box from a folder which is not its own.
TEST_F(CommandLine, RootAllowsFilesOfANamedFolder) {
    const fs::path world = write("in_world.wrl", "#VRML V2.0 utf8\nInline { url \"box.wrl\" }\n"), points = write("p.csv", "0,0,0\n");
    fs::create_directories(folder_ / "own");
    fs::create_directories(folder_ / "lib");
    fs::rename(world, folder_ / "own/world.wrl");
    std::ofstream(folder_ / "lib/box.wrl") << "#VRML V2.0 utf8\nShape { geometry Box { size 2 2 2 } }\n";
    const std::string file = (folder_ / "own/world.wrl").string(), root = " --root " + (folder_ / "lib").string() + " ";
    for (const std::string& command : {"check" + root + file, "convert" + root + file + " " + (folder_ / "o.obj").string(),
                                       "query" + root + file + " " + points.string(), "collide" + root + file + " " + file,
                                       "view" + root + file + " --size 64x48 --out " + (folder_ / "o.png").string()}) {
        const Outcome allowed = run(command);
        EXPECT_EQ(allowed.code, 0) << command << allowed.err;
        std::string without = command, gone = command;
        without.erase(without.find(root), root.size() - 1);
        gone.replace(gone.find("/lib "), 5, "/gone ");
        const Outcome refused = run(without), absent = run(gone);
        EXPECT_EQ(refused.code, 2) << without;
        EXPECT_NE((refused.err + refused.out).find("'box.wrl' is not read: there is no such file"), std::string::npos) << refused.err;
        EXPECT_NE(absent.err.find("/gone: there is no such folder"), std::string::npos) << absent.err;
    }
}

TEST_F(CommandLine, QueryAnswersInFileUnits) {
    const fs::path whole = write("whole.obj", cube(2)), points = write("p.csv", "x,y,z\n1,1,0.25\n1,1,-3\n3,3,3\n");
    const Outcome outcome = run("query " + whole.string() + " " + points.string());
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    std::istringstream lines(outcome.out);
    std::string line;
    std::getline(lines, line);
    EXPECT_EQ(line, "distance,cx,cy,cz,triangle,feature");
    const double expected[][4] = {{-0.25, 1, 1, 0}, {3, 1, 1, 0}, {std::sqrt(3.0), 2, 2, 2}};
    for (const auto& row : expected) {
        std::getline(lines, line);
        double d, x, y, z;
        ASSERT_EQ(std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf", &d, &x, &y, &z), 4) << line;
        EXPECT_DOUBLE_EQ(d, row[0]);
        EXPECT_DOUBLE_EQ(x, row[1]);
        EXPECT_DOUBLE_EQ(y, row[2]);
        EXPECT_DOUBLE_EQ(z, row[3]);
    }
}

// A corner that triangles share is named by the lowest of them, with its own coordinates, wherever the mesh is turned.
TEST_F(CommandLine, QueryNamesSharedCornersByTheLowestTriangle) {
    for (int turn = 0; turn < 24; ++turn) {
        const double c = std::cos(0.1 + turn), s = std::sin(0.1 + turn), h = 0.3 + 0.1 * turn;
        std::ostringstream obj, points;
        obj.precision(17), points.precision(17);
        const auto place = [&](double x, double y, double z) {
            std::ostringstream text;
            text.precision(17);
            text << c * x - s * z << " " << y << " " << s * x + c * z << "\n";
            return text.str();
        };
        const int n = 7 + turn;  // a double cone
        obj << "v " << place(0, 0, h) << "v " << place(0, 0, -h);
        points << place(0, 0, h) << place(0, 0, 2 * h);
        for (int i = 0; i < n; ++i) {
            const double x = std::cos(2 * M_PI * i / n), y = std::sin(2 * M_PI * i / n);
            obj << "v " << place(x, y, 0);
            points << place(x, y, 0);
        }
        for (int i = 0; i < n; ++i) obj << "f 1 " << 3 + i << " " << 3 + (i + 1) % n << "\nf 2 " << 3 + (i + 1) % n << " " << 3 + i << "\n";
        const Outcome outcome = run("query " + write("cone.obj", obj.str()).string() + " " + write("p.csv", points.str()).string());
        std::istringstream lines(outcome.out), places(points.str());
        std::string line, place_line;
        std::getline(lines, line);
        for (int row = 0; row < n + 2; ++row) {
            ASSERT_TRUE(std::getline(lines, line));
            const std::string tail = line.substr(line.rfind(',', line.rfind(',') - 1) + 1);
            // ring corner i: triangles 2 i - 2, 2 i - 1, 2 i, 2 i + 1, of which those of corner 0 begin at 0
            const int i = row - 2, lowest = i <= 0 ? 0 : 2 * i - 2;
            EXPECT_EQ(tail, std::to_string(lowest) + (row < 2 ? ",vertex0" : i == 0 ? ",vertex1" : ",vertex2")) << turn << ": " << line;
        }
    }
}

// Touching is one answer for all kinds of features: an overlap of depth 0; a last bit apart is none.
TEST_F(CommandLine, CollideCallsEveryTouchAnOverlap) {
    const std::string box = write("box.obj", cube()).string();
    const auto tetrahedron = [&](const std::string& name, const std::string& corners) {
        return write(name + ".obj", corners + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n").string();
    };
    const std::string on_face = tetrahedron("face", "v 1 .5 .25\nv 2 .25 .25\nv 2 1 .25\nv 2 .5 1\n");
    const std::string on_edge = tetrahedron("edge", "v 1 1 .25\nv 2 1.25 .25\nv 2 2 .25\nv 2 1.5 1\n");
    const std::string across = tetrahedron("across", "v 1.5 .5 .5\nv .5 1.5 .5\nv 2 2 .25\nv 2 2 1\n");
    const std::string edge_in_face = tetrahedron("in", "v 1 .25 .25\nv 1 .75 .5\nv 2 .5 .25\nv 2 .5 1\n");
    const auto collide = [&](const std::string& arguments) { return nlohmann::json::parse(run("collide --json " + arguments).out); };
    for (const std::string& other : {on_face, on_edge, across, edge_in_face}) {
        for (const std::string& pair : {box + " " + other, other + " " + box}) {
            const nlohmann::json touch = collide(pair);
            EXPECT_EQ(touch["overlap"], true) << pair;
            EXPECT_EQ(touch["depth"], 0.0) << pair;
        }
        EXPECT_EQ(collide(box + " " + other + " --move-b \"1e-15 1e-15 0\"")["overlap"], false) << other;
        EXPECT_EQ(collide(box + " " + other + " --move-b \"-1e-15 -1e-15 0\"")["overlap"], true) << other;
    }
    for (const char* move : {"1 0 0", "1 .25 .5", "1 1 0", "1 1 .5", "1 1 1"}) {
        const std::string pair = box + " " + box + " --move-b \"" + move;
        EXPECT_EQ(collide(pair + "\"")["overlap"], true) << move;
        EXPECT_EQ(collide(pair + "\"")["depth"], 0.0) << move;
        std::string apart = pair;
        apart.replace(apart.rfind("\"1") + 1, 1, "1.0000000000000002");
        EXPECT_EQ(collide(apart + "\"")["overlap"], false) << move;
    }
}

// Coordinates beyond the range of float's squares are refused; below, sizes do not matter.
TEST_F(CommandLine, HugeCoordinatesAreRefusedAndOthersAnswered) {
    for (int power = -60; power <= 160; power += 10) {
        const double size = std::pow(10, power);
        const std::string box = write("box.obj", cube(size)).string(), e = "e" + std::to_string(power);
        const Outcome outcome = run("collide --json " + box + " " + box + " --move-b \".75" + e + " 0 0\"");
        const Outcome asked = run("query " + box + " " + write("p.csv", ".5" + e + " .5" + e + " .25" + e + "\n").string());
        EXPECT_EQ(outcome.code, power <= 30 ? 0 : 2) << power << outcome.err;
        EXPECT_EQ(asked.code, power <= 30 ? 0 : 2) << power << asked.err;
        if (power > 30) continue;
        const nlohmann::json answer = nlohmann::json::parse(outcome.out);
        EXPECT_EQ(answer["overlap"], true) << power;
        EXPECT_NEAR(answer["depth"].get<double>() / size, 0.25, 1e-9) << power;
        EXPECT_NEAR(std::stod(asked.out.substr(asked.out.find('\n') + 1)) / size, -0.25, 1e-12) << power;
    }
    EXPECT_EQ(run("collide shape:box shape:box --move-b \"1e40 0 0\"").code, 2);
}

TEST_F(CommandLine, QueryRefusesABadRowWithItsLine) {
    const fs::path whole = write("whole.obj", cube()), points = write("p.csv", "x,y,z\n1,1,1\n1,nan,1\n");
    const Outcome outcome = run("query " + whole.string() + " " + points.string());
    EXPECT_EQ(outcome.code, 2);
    EXPECT_NE(outcome.err.find("p.csv:3:"), std::string::npos) << outcome.err;
}

TEST_F(CommandLine, QueryLosesNoRowAndKnowsTheInsideOfTurnedFaces) {
    const fs::path whole = write("whole.obj", cube(2));
    for (const char* first : {"nan,nan,nan", "inf,0,0", "\"1\",2,3", "1e400,0,0", "1e155,0,0"}) {
        const Outcome outcome = run("query " + whole.string() + " " + write("first.csv", std::string(first) + "\n1,1,1\n").string());
        EXPECT_EQ(outcome.code, 2) << first;
        EXPECT_NE(outcome.err.find("first.csv:1:"), std::string::npos) << outcome.err;
    }
    std::string turned = cube(2);
    const size_t face = turned.rfind("f ");
    std::istringstream words(turned.substr(face + 2));
    std::vector<std::string> corner{std::istream_iterator<std::string>(words), {}};
    std::reverse(corner.begin(), corner.end());
    turned.resize(face + 1);
    for (const std::string& c : corner) turned += " " + c;
    const fs::path file = write("turned.obj", turned + "\n");
    const Outcome outcome = run("query " + file.string() + " " + write("one.csv", "1,1,0.25\n").string());
    EXPECT_NE(outcome.out.find("\n-0.25,"), std::string::npos) << outcome.out;
    EXPECT_NE(outcome.err.find("turned to agree"), std::string::npos) << outcome.err;
    EXPECT_EQ(nlohmann::json::parse(run("check --json " + file.string()).out)["imported_as"], "solid");
}

TEST_F(CommandLine, WhatCannotBeIsRefusedInOneLine) {
    for (const auto& [arguments, reason] :
         std::vector<std::pair<std::string, std::string>>{{"bogus", "there is no command \"bogus\""},
                                                          {"runn palpate", "did you mean run?"},
                                                          {"run palpate --second 1", "no option --second; did you mean --seconds?"},
                                                          {"run palpat", "did you mean \"palpate\"?"},
                                                          {"soak palpate --minutes 0", "--minutes: 0 must be more than 0"},
                                                          {"run palpate --seconds 100ms", "--seconds: \"100ms\" is not a number"},
                                                          {"run probe_on_liver --seconds -1", "--seconds"},
                                                          {"run probe_on_liver --threads 100000", "--threads"},
                                                          {"run probe_on_liver --out x --capture \"\"", "--capture"},
                                                          {"view shape:sphere --out a.jpg", "must end in .png"}}) {
        const Outcome outcome = run(arguments);
        EXPECT_EQ(outcome.code, 2) << arguments;
        EXPECT_NE(outcome.err.find(reason), std::string::npos) << outcome.err;
    }
    const std::string scene = "[[body]]\nname = \"NAME\"\nshape = \"sphere\"\n";
    for (const char* name : {"../evil", "a\\\"b", "tab\\tbed"}) {
        std::string text = scene;
        text.replace(text.find("NAME"), 4, name);
        const Outcome outcome = run("check " + write("names.toml", text).string());
        EXPECT_EQ(outcome.code, 2) << name;
        EXPECT_NE(outcome.err.find("the name of a body"), std::string::npos) << outcome.err;
    }
}

// An interrupted run writes its results and captures and returns the exit code that shells expect.
TEST_F(CommandLine, AStoppedRunKeepsWhatItHas) {
    const fs::path out = folder_ / "stopped", err = folder_ / "stopped.txt";
    // the file of pass 9 appears when pass 8 is done, the first that "worst" judges; on a busy machine this
    // may take minutes
    const std::string command =
        "cd " + trocar::source_folder().string() + "; " + trocar::program_path().string() +
        " run probe_on_liver --set liver.triangles=300 --no-render --seconds 10000 --threads 1 --capture worst,9-9 --out " + out.string() +
        " 2> " + err.string() + " > /dev/null & for i in $(seq 3000); do test -e " + out.string() +
        "/captures/passes_9-9.cap && break; sleep 0.1; done; kill -TERM $!; wait $!";
    const int status = std::system(command.c_str());
    EXPECT_EQ(WEXITSTATUS(status), 128 + 15);
    std::stringstream told;
    told << std::ifstream(err).rdbuf();
    EXPECT_NE(told.str().find("stopped by SIGTERM"), std::string::npos) << told.str();
    const nlohmann::json metrics = nlohmann::json::parse(std::ifstream(out / "metrics.json"));
    EXPECT_EQ(metrics["stopped_by"], "SIGTERM");
    EXPECT_GT(metrics["simulated_s"].get<double>(), 0);
    EXPECT_TRUE(fs::exists(out / "captures/worst.cap"));
    EXPECT_TRUE(fs::exists(out / "report.html"));
}

// A non-finite result is reported, and the exit code says that the figures are meaningless.
TEST_F(CommandLine, ABrokenSimulationIsTold) {
    const Outcome outcome = run("run " + write("broken.toml",
                                               "seconds = 0.5\n[[body]]\nname = \"a\"\nshape = \"sphere\"\ntriangles = 80\nmotion = "
                                               "\"free\"\nsize = 1e-3\nvelocity = [1e200, 0.0, 0.0]\n")
                                             .string());
    EXPECT_EQ(outcome.code, 1) << outcome.err << outcome.out;
    EXPECT_NE(outcome.err.find("the simulation broke"), std::string::npos) << outcome.err;
}

TEST_F(CommandLine, CollideReportsTheDepthOfTwoCubes) {
    // a small cube pushed 0.25 into the middle of a big one's top face: the thesis depth is 0.25, upwards
    const fs::path big = write("big.obj", cube(4)), small = write("small.obj", cube(1));
    const Outcome outcome = run("collide " + big.string() + " " + small.string() + " --move-b \"1.5 1.5 3.75\" --json");
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const nlohmann::json j = nlohmann::json::parse(outcome.out);
    EXPECT_TRUE(j["overlap"]);
    EXPECT_NEAR(j["depth"], 0.25, 1e-12);
    EXPECT_NEAR(j["direction"][2], 1, 1e-9);
    EXPECT_EQ(j["vertices_a_in_b"], 0);
    EXPECT_EQ(j["vertices_b_in_a"], 4);
    EXPECT_TRUE(j.contains("witness") && j.contains("edge_contacts") && j.contains("time_ms"));
    EXPECT_GT(j["cells"], 0);
    const Outcome apart = run("collide " + big.string() + " " + small.string() + " --move-b \"1.5 1.5 4.25\" --json");
    EXPECT_FALSE(nlohmann::json::parse(apart.out)["overlap"]);
    // rotated by 45 degrees about x so that it touches with an edge, sqrt(1/2) below its centre
    const Outcome turned = run("collide " + big.string() + " " + small.string() + " --rotate-b \"1 0 0 45\" --move-b \"1.5 2 3.9\" --json");
    EXPECT_NEAR(nlohmann::json::parse(turned.out)["depth"], 0.1, 1e-9) << turned.out;
}

TEST_F(CommandLine, CollideWritesTheSharedCells) {
    const fs::path big = write("big.obj", cube(4)), small = write("small.obj", cube(1)), cells = folder_ / "cells.json";
    const std::string pair = "collide " + big.string() + " " + small.string() + " --move-b \"1.5 1.5 3.75\" --json --cells ";
    const Outcome outcome = run(pair + cells.string());
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const nlohmann::json layers = nlohmann::json::parse(std::ifstream(cells));
    ASSERT_EQ(layers["cells"].size(), nlohmann::json::parse(outcome.out)["cells"]);
    ASSERT_GT(layers["cells"].size(), 0u);
    for (const nlohmann::json& cell : layers["cells"]) {
        // a shared cell lists both bodies, and the box of each listed triangle reaches it
        ASSERT_EQ(cell["objects"].size(), 2u);
        for (const nlohmann::json& object : cell["objects"]) ASSERT_FALSE(object["triangles"].empty());
        for (int k = 0; k < 3; ++k) {
            const double size = layers["cell_size"], low = layers["origin"][k].get<double>() + size * cell["cell"][k].get<double>();
            EXPECT_LE(low, k == 2 ? 4.1 : 2.6);
            EXPECT_GE(low + size, k == 2 ? 3.7 : 1.4);
        }
    }
    for (const char* name : {"cells.vtp", "cells.png"}) {
        ASSERT_EQ(run(pair + (folder_ / name).string()).code, 0);
        EXPECT_GT(fs::file_size(folder_ / name), 500u);
    }
    EXPECT_EQ(run(pair + (folder_ / "cells.txt").string()).code, 2);
}

TEST_F(CommandLine, CollideReportsRegionsAndContours) {
    const fs::path big = write("big.obj", cube(4)), small = write("small.obj", cube(1)), lines = folder_ / "contour.obj";
    const std::string pair = "collide " + big.string() + " " + small.string();
    const auto ask = [&](const std::string& more) { return nlohmann::json::parse(run(pair + more + " --json").out); };
    // a quarter of the small cube's height below the big one's top face
    const nlohmann::json top = ask(" --move-b \"1.5 1.5 3.75\" --contours " + lines.string());
    ASSERT_EQ(top["regions"].size(), 1u) << top;
    const nlohmann::json& region = top["regions"][0];
    EXPECT_NEAR(region["volume"], 0.25, 1e-14);
    EXPECT_NEAR(region["area"], 1 + 1 + 4 * 0.25, 1e-14);
    EXPECT_NEAR(region["contour"]["length"], 4, 1e-14);
    EXPECT_EQ(region["contour"]["curves"], 1);
    EXPECT_EQ(region["depth"], top["depth"]);
    EXPECT_EQ(region["vertices_a"], 0);
    EXPECT_EQ(region["vertices_b"], 4);
    // the bottom of the small cube and the top of the big one have the same depth: either may be the witness
    const double from = region["witness"]["point"][2], to = region["witness"]["closest"][2];
    EXPECT_NEAR(std::max(from, to), 4, 1e-14);
    EXPECT_NEAR(std::min(from, to), 3.75, 1e-14);
    EXPECT_TRUE(top["contained"].is_null());
    EXPECT_FALSE(top["saturated"]);
    std::ifstream in(lines);
    std::string line;
    uint32_t points = 0, curves = 0;
    while (std::getline(in, line)) {
        points += line.starts_with("v ");
        curves += line.starts_with("l ");
    }
    EXPECT_GE(points, 8u);
    EXPECT_EQ(curves, 1u);
    // in the centre all separating translations are equally long
    const nlohmann::json middle = ask(" --move-b \"1.5 1.5 1.5\"");
    EXPECT_EQ(middle["contained"], "b");
    EXPECT_TRUE(middle["saturated"]);
    EXPECT_NEAR(middle["regions"][0]["volume"], 1, 1e-14);
    // out through the nearest face: half the sum of the edges
    const nlohmann::json bracket = ask(" --move-b \"1.5 1.5 3.0\" --separate")["separation"];
    EXPECT_NEAR(bracket["lower"], 1.0, 1e-12);
    EXPECT_GE(bracket["upper"], 1.0);
    EXPECT_LE(bracket["upper"], 1.05);
    EXPECT_GT(bracket["translation"][2], 0.9);
    const nlohmann::json apart = ask(" --move-b \"1.5 1.5 4.25\"");
    EXPECT_TRUE(apart["regions"].empty() && apart["contained"].is_null() && !apart["saturated"]);
}

TEST_F(CommandLine, CrossCheckCountsSignsThatDiffer) {
    const fs::path big = write("big.obj", cube(4)), small = write("small.obj", cube(1));
    const std::string pair = "collide " + big.string() + " " + small.string() + " --move-b \"1.5 1.5 3.75\" --json";
    EXPECT_EQ(nlohmann::json::parse(run(pair + " --cross-check").out)["disagreements"], 0);
    EXPECT_FALSE(nlohmann::json::parse(run(pair).out).contains("disagreements"));
    const fs::path points = write("p.csv", "2,2,2\n2,2,3.9\n9,9,9\n");
    const Outcome plain = run("query " + big.string() + " " + points.string());
    const Outcome checked = run("query --cross-check " + big.string() + " " + points.string());
    EXPECT_EQ(checked.out, plain.out);
    EXPECT_NE(checked.err.find("0 of 3 signs differ"), std::string::npos) << checked.err;
}

// Breaks when a run's trees are not Embree's, or when the choice of traversal changes a result.
TEST_F(CommandLine, EmbreeBuildsTheTreesAndMayWalkThem) {
    const auto metrics_of = [&](const std::string& search) {
        const fs::path out = folder_ / search;
        const Outcome outcome =
            run("run kidney_on_liver --seconds 0.2 --no-render --set contact.search=" + search + " --out " + out.string());
        EXPECT_EQ(outcome.code, 0) << outcome.err;
        std::ifstream metrics(out / "metrics.json");
        return nlohmann::json::parse(metrics);
    };
    const nlohmann::json own = metrics_of("own"), embree = metrics_of("embree");
    EXPECT_EQ(own["state_hash"], embree["state_hash"]);
    const nlohmann::json& search = own["contact"]["search"];
    EXPECT_EQ(search["built_by"].get<std::string>().rfind("embree 3.", 0), 0u) << search;
    EXPECT_GE(search["builds"], 2);
    EXPECT_GT(search["queries"], 0);
    EXPECT_EQ(search["walk"], "own");
    EXPECT_EQ(embree["contact"]["search"]["walk"], "embree");
    EXPECT_EQ(embree["contact"]["search"]["queries"], search["queries"]);

    const fs::path big = write("big.obj", cube(4)), small = write("small.obj", cube(1)), points = write("p.csv", "2,2,2\n2,2,3.9\n9,9,9\n");
    const std::string query = "query " + big.string() + " " + points.string();
    EXPECT_EQ(run(query + " --search embree").out, run(query).out);
    EXPECT_EQ(run(query + " --search walk").code, 2);
    const std::string collide = "collide " + big.string() + " " + small.string() + " --move-b \"1.5 1.5 3.75\" --json --search ";
    const nlohmann::json a = nlohmann::json::parse(run(collide + "embree").out), b = nlohmann::json::parse(run(collide + "own").out);
    EXPECT_EQ(a["depth"], b["depth"]);
    EXPECT_EQ(a["witness"], b["witness"]);
}

// Of a trace: spans have times and tracks with names; a pass has one span and each of three counters, which hold nothing else;
// arrows lead from the end of a pass to the begin of the next, in pairs.
void check_trace(const nlohmann::json& trace, size_t passes) {
    std::set<double> named, used;
    std::map<std::string, size_t> counts;
    std::map<uint64_t, double> begun;             // us, of arrows that have not ended
    std::vector<std::pair<double, double>> pass;  // us, begin and end
    std::vector<std::pair<double, double>> arrow;
    for (const nlohmann::json& e : trace["traceEvents"]) {
        const std::string kind = e["ph"], name = e["name"];
        if (kind == "M") {
            if (name == "thread_name") named.insert(e["tid"].get<double>());
            continue;
        }
        EXPECT_TRUE(std::isfinite(e["ts"].get<double>())) << e;
        if (kind == "X") {
            EXPECT_GE(e["dur"].get<double>(), 0) << e;
            used.insert(e["tid"].get<double>());
            if (name == "pass") pass.emplace_back(e["ts"], e["ts"].get<double>() + e["dur"].get<double>());
        } else if (kind == "C") {
            ++counts[name];
            EXPECT_EQ(e["args"].size(), 1u) << e;
            EXPECT_TRUE(e["args"][name].is_number()) << e;
        } else if (kind == "s") {
            EXPECT_TRUE(begun.emplace(e["id"], e["ts"]).second) << "two arrows of one number";
        } else if (kind == "f") {
            const auto from = begun.find(e["id"]);
            ASSERT_NE(from, begun.end()) << "an arrow from nowhere";
            arrow.emplace_back(from->second, e["ts"]);
            begun.erase(from);
        }
    }
    EXPECT_TRUE(begun.empty()) << "an arrow to nowhere";
    ASSERT_EQ(pass.size(), passes);
    for (const char* counter : {"contacts", "depth_mm", "force_n"}) EXPECT_EQ(counts[counter], passes) << counter;
    for (const double track : used) EXPECT_TRUE(named.contains(track)) << "a track without a name: " << track;
    ASSERT_EQ(arrow.size(), passes - 1);
    for (size_t i = 0; i + 1 < passes; ++i) {
        EXPECT_NEAR(arrow[i].first, pass[i].second, 0.005) << "the end of the pass";
        EXPECT_NEAR(arrow[i].second, pass[i + 1].first, 0.005) << "the begin of the next";
    }
}

TEST_F(CommandLine, RunWritesWhatItSays) {
    const fs::path out = folder_ / "run";
    const Outcome outcome =
        run("run probe_on_liver --seconds 0.2 --set liver.triangles=1000 --set probe.triangles=1000 --out " + out.string());
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    std::ifstream metrics(out / "metrics.json"), trace(out / "trace.json");
    const nlohmann::json m = nlohmann::json::parse(metrics), t = nlohmann::json::parse(trace);
    EXPECT_EQ(m["frames"], 6);
    for (const char* key : {"events", "max_depth_m", "total_ms_mean", "total_ms_p99", "response_ms_mean"})
        EXPECT_TRUE(m["contact"].contains(key)) << key;
    EXPECT_EQ(m["haptics"]["ticks"], 200);
    EXPECT_TRUE(m["haptics"].contains("max_force_n") && m.contains("energy") && m.contains("report") && m.contains("state_hash"));
    for (const auto& [name, stage] : m["stages"].items())
        EXPECT_TRUE(stage.contains("p50_ms") && stage.contains("p99_ms") && stage.contains("max_ms")) << name;
    check_trace(t, 12);
    EXPECT_TRUE(fs::exists(out / "report.html") && fs::exists(out / "frames" / "000000.png") && fs::exists(out / "meshes"));
    for (const auto& entry : fs::recursive_directory_iterator(out))
        EXPECT_EQ(entry.path().filename().string().find("tmp"), std::string::npos) << entry.path();
}

// Breaks when mesh files of many bodies are omitted silently, or when time outside of passes is not reported.
TEST_F(CommandLine, ALargeRunTellsWhatItLeavesOutAndWhatItTook) {
    const Outcome outcome = run("run stress_sparse --set count=501 --set resolution=20 --seconds 0.1 --no-render --capture worst --out " +
                                (folder_ / "many").string());
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_NE(outcome.out.find("not meshes/ of so many bodies: --export-every N writes them"), std::string::npos) << outcome.out;
    EXPECT_NE(outcome.out.find(" s, built in "), std::string::npos) << outcome.out;
    EXPECT_NE(outcome.out.find("keeping states and writing captures: "), std::string::npos) << outcome.out;
    std::ifstream file(folder_ / "many" / "metrics.json");
    const nlohmann::json metrics = nlohmann::json::parse(file);
    EXPECT_GT(metrics["build_s"], 0.0);
    EXPECT_GT(metrics["capture_s"], 0.0);
    EXPECT_FALSE(fs::exists(folder_ / "many" / "meshes"));
}

TEST_F(CommandLine, ReportTellsTheContactRateOfTheRun) {
    const fs::path out = folder_ / "rate";
    for (const char* rate : {"30", "120"}) {
        const Outcome outcome =
            run("run probe_on_liver --seconds 0.2 --no-render --set liver.triangles=300 --set probe.triangles=300 --set contact.rate=" +
                std::string(rate) + " --out " + out.string());
        ASSERT_EQ(outcome.code, 0) << outcome.err;
        std::ifstream file(out / "report.html");
        const std::string page(std::istreambuf_iterator<char>(file), {});
        EXPECT_NE(page.find(" passes (" + std::string(rate) + " a second)"), std::string::npos) << rate;
    }
}

// A freely falling ball has no elastic energy: the energy error is relative to the gravitational energy
// released.
TEST_F(CommandLine, TheEnergyErrorIsOfAllMechanicalEnergy) {
    const std::string scene =
        "gravity = [0.0, 0.0, -10.0]\n[[body]]\nname = \"a\"\nshape = \"sphere\"\nsize = 0.1\ntriangles = 320\nmotion = \"free\"\n";
    const Outcome outcome = run("run " + write("fall.toml", scene).string() + " --seconds 0.5 --no-render --json");
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const nlohmann::json energy = nlohmann::json::parse(outcome.out)["energy"];
    EXPECT_EQ(energy["peak_elastic_j"], 0);
    const double kinetic = energy["kinetic_j"], peak = energy["peak_j"], open = energy["worst_balance_j"];
    EXPECT_GT(kinetic, 1);
    EXPECT_NEAR(peak, kinetic, 0.01 * kinetic) << "of a fall the one becomes the other";
    EXPECT_EQ(energy["worst_balance_of_peak"], open / peak);
    EXPECT_LT(open, 1e-3 * peak);
}

// The trace, half a million spans in 20 MB, is not counted as memory of the two bodies.
TEST_F(CommandLine, BytesOfABodyAreThoseOfTheWorld) {
    const std::string scene = "run probe_on_liver --no-render --json --seconds 0.1 --set liver.triangles=300 --set probe.triangles=300";
    const Outcome bare = run(scene), traced = run(scene + " --capture 0-2 --out " + (folder_ / "out").string());
    const auto bytes = [](const Outcome& o) { return nlohmann::json::parse(o.out)["scale"]["bytes_per_body"].get<double>(); };
    EXPECT_GT(bytes(bare), 1e4);
    EXPECT_LT(bytes(traced), bytes(bare) + 5e6);
}

TEST_F(CommandLine, ALiveRunIsRepeatedFromItsRecording) {
    const fs::path out = folder_ / "live", recording = out / "live.recording";
    const std::string scene = "run probe_on_liver --set liver.triangles=1000 --set probe.triangles=1000 ";
    const Outcome live = run(scene + "--live --seconds 0.2 --json --out " + out.string());
    ASSERT_EQ(live.code, 0) << live.err;
    const Outcome told = run(scene + "--live --seconds 0.2 --out " + (folder_ / "told").string());
    unsigned drawn = 0, dropped = 0;
    const size_t line = told.out.find(" pictures drawn beside it, ");
    ASSERT_NE(line, std::string::npos) << told.out;
    ASSERT_EQ(std::sscanf(told.out.c_str() + told.out.rfind('\n', line) + 1, " %u pictures drawn beside it, %u dropped", &drawn, &dropped),
              2)
        << told.out;
    EXPECT_EQ(drawn + dropped, 6u) << "thirty a second";
    const Outcome again = run(scene + "--no-render --json --replay " + recording.string());
    ASSERT_EQ(again.code, 0) << again.err;
    const nlohmann::json a = nlohmann::json::parse(live.out), b = nlohmann::json::parse(again.out);
    EXPECT_EQ(a["state_hash"], b["state_hash"]);
    EXPECT_EQ(a["simulated_s"], b["simulated_s"]);
    EXPECT_TRUE(b["replay"]["same"]);
    const Outcome other = run(scene + "--set liver.tissue.youngs_modulus=6e3 --replay " + recording.string());
    EXPECT_EQ(other.code, 2);
    EXPECT_NE(other.err.find("live.recording: was recorded with another scene"), std::string::npos) << other.err;
    expect_one_line(other.err);
    fs::resize_file(recording, fs::file_size(recording) / 2);
    const Outcome cut = run(scene + "--replay " + recording.string());
    EXPECT_EQ(cut.code, 2);
    EXPECT_NE(cut.err.find("live.recording: recording of 12 contact passes"), std::string::npos) << cut.err;
    expect_one_line(cut.err);
    EXPECT_EQ(run(scene + "--live --replay " + recording.string()).code, 2);
}

TEST_F(CommandLine, ViewDrawsAMeshOrRefusesInOneLine) {
    const fs::path whole = write("cube.obj", cube()), out = folder_ / "cube.png";
    const Outcome drawn = run("view " + whole.string() + " --size 120x90 --out " + out.string());
    ASSERT_EQ(drawn.code, 0) << drawn.err;
    const trocar::Image picture = trocar::load_image(out);
    EXPECT_EQ(picture.width, 120u);
    EXPECT_EQ(picture.height, 90u);
    EXPECT_EQ(run("view shape:probe:1000 cube --sheet --size 64x64 --out " + out.string()).code, 2);  // no such file
    EXPECT_EQ(run("view shape:probe:1000 box --size 64x64 --out " + out.string()).code, 0);
    for (const std::string& arguments :
         {std::string("view box --size 0x9 --out a.png"), std::string("view box --size 9 --out a.png"),
          std::string("view box --size 99999x99999 --out a.png"), std::string("view shape:lever --out a.png"),
          std::string("view shape:box:1e3 --out a.png"), std::string("view shape:box:12:1:1 --out a.png"),
          std::string("view box --azimuth nan --out a.png"), "view box --out " + (folder_ / "absent/x.png").string(),
          std::string("view nowhere.obj --out a.png")}) {
        const Outcome refused = run(arguments);
        EXPECT_EQ(refused.code, 2) << arguments;
        expect_one_line(refused.err);
    }
    EXPECT_FALSE(fs::exists(folder_ / "absent"));
}

TEST_F(CommandLine, ShapesServeWhereAMeshIsAsked) {
    const Outcome check = run("check shape:sphere:2000 --json");
    ASSERT_EQ(check.code, 0) << check.err;
    EXPECT_NEAR(nlohmann::json::parse(check.out)["volume"], M_PI / 6, 5e-3);
    const fs::path out = folder_ / "liver.obj";
    ASSERT_EQ(run("convert shape:liver:1000:3 " + out.string()).code, 0);
    EXPECT_EQ(run("check " + out.string()).code, 0);
    const Outcome scenes = run("scenes");
    EXPECT_NE(scenes.out.find("shape:NAME"), std::string::npos);
    EXPECT_NE(scenes.out.find("kidney"), std::string::npos);
}

TEST_F(CommandLine, ScenesAreListed) {
    const Outcome outcome = run("scenes --json");
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const nlohmann::json j = nlohmann::json::parse(outcome.out);
    EXPECT_GE(j.size(), 3u);
}

// Balls fall past each other: at 30 Hz each pass finds overlap that the previous one could not predict.
// Breaks when a run does not report the remedy, or reports it where contacts are found in time.
TEST_F(CommandLine, RunSaysWhenContactsAreFoundLate) {
    const auto said = [&](const std::string& rate) {
        const Outcome o = run("run stress_rain --set count=60 --seconds 0.6 --no-render --set contact.rate=" + rate + " --out " +
                              (folder_ / "o").string());
        EXPECT_EQ(o.code, 0) << o.err;
        return o.out;
    };
    EXPECT_NE(said("30").find("--set contact.rate=60 finds them earlier"), std::string::npos) << said("30");
    EXPECT_EQ(said("60").find("finds them earlier"), std::string::npos);
}

}  // namespace
