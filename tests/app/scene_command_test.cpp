#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "components/math.hpp"
#include "engine/files/child_process.hpp"
#include "tests/app/run_program.hpp"

// trocar scene from the user's point of view: bodies stand where the file has them.
namespace {
namespace fs = std::filesystem;
using trocar::Outcome;
using trocar::Vec3d;

class SceneCommand : public testing::Test {
 protected:
    void SetUp() override {
        folder_ =
            fs::path(testing::TempDir()) / (std::string("trocar_scene_") + testing::UnitTest::GetInstance()->current_test_info()->name());
        fs::remove_all(folder_);
        fs::create_directories(folder_);
    }
    void TearDown() override { fs::remove_all(folder_); }
    // Balls of radius 9 (label 3) and 5 (label 8) mm, 5.13 mm apart, in patient axes.
    void write_balls() const {
        std::ofstream file(folder_ / "balls.mha", std::ios::binary);
        file << "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nElementSpacing = 0.5 0.5 1\n"
                "DimSize = 72 56 24\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
        for (int z = 0; z < 24; ++z)
            for (int y = 0; y < 56; ++y)
                for (int x = 0; x < 72; ++x) {
                    const auto within = [&](const Vec3d& c, double r) { return (Vec3d(0.5 * x, 0.5 * y, z) - c).norm() < r; };
                    file.put(within({11, 12, 11.6}, 9) ? 3 : within({28, 20, 8}, 5) ? 8 : 0);
                }
    }
    void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
    Outcome run(const std::string& arguments) const { return trocar::run_program(arguments, folder_, folder_); }
    nlohmann::json make(const std::string& arguments) const {
        const Outcome outcome = run("scene " + arguments + " --json");
        EXPECT_EQ(outcome.code, 0) << outcome.err;
        return nlohmann::json::parse(outcome.out);
    }
    static Vec3d centroid(const nlohmann::json& j, const std::string& name) {
        for (const auto& body : j["bodies"])
            if (body["name"] == name) {
                const auto at = body["centroid_m"].get<std::array<double, 3>>();
                return {at[0], at[1], at[2]};
            }
        ADD_FAILURE() << "no body " << name;
        return Vec3d::Zero();
    }
    fs::path folder_;
};

TEST_F(SceneCommand, OrgansOfAnImageKeepTheirPlaces) {
    if (trocar::find_helper_program("trocar-volume-reader").empty()) GTEST_SKIP() << "built without ITK";
    write_balls();
    write("table.csv", "label,name,tissue,color,triangles\n8,small one,liver,0.1 0.2 0.3,300\n3,big,kidney,,\n");
    const auto j = make("balls.mha out/balls.toml --labels table.csv --triangles 600");
    ASSERT_EQ(j["bodies"].size(), 2u);
    EXPECT_EQ(j["links"].size(), 0u);
    // left, back, head become left, head, front
    const Vec3d apart = centroid(j, "small one") - centroid(j, "big");
    EXPECT_LT((apart - Vec3d(17e-3, -3.6e-3, -8e-3)).norm(), 0.1e-3) << apart.transpose();
    EXPECT_NEAR(j["bodies"][1]["volume_m3"].get<double>(), 4.0 / 3 * M_PI * 9e-3 * 9e-3 * 9e-3, 0.02 * 3e-6);
    const Outcome outcome = run("run out/balls.toml --seconds 0.05 --no-render --out out/run");
    EXPECT_EQ(outcome.code, 0) << outcome.err;
}

TEST_F(SceneCommand, OrgansThatTouchAreLinked) {
    if (trocar::find_helper_program("trocar-volume-reader").empty()) GTEST_SKIP() << "built without ITK";
    write_balls();
    write("table.csv", "label,name,tissue\n8,small,liver\n3,big,kidney\n");
    EXPECT_EQ(make("balls.mha near.toml --labels table.csv --triangles 600 --touch 0.0045")["links"].size(), 0u);
    const auto j = make("balls.mha near.toml --labels table.csv --triangles 600 --touch 0.006");
    ASSERT_EQ(j["links"].size(), 1u);
    EXPECT_EQ(j["links"][0]["to"], "big");
    // between particles, which may be half an edge farther apart than the surfaces
    EXPECT_GT(j["links"][0]["within_m"].get<double>(), 0.006);
    EXPECT_EQ(run("run near.toml --seconds 0.05 --no-render --out out/run").code, 0);
}

TEST_F(SceneCommand, MeasuredValuesAndFaultyTablesAreRefused) {
    if (trocar::find_helper_program("trocar-volume-reader").empty()) GTEST_SKIP() << "built without ITK";
    write_balls();
    const auto refusal = [&](const std::string& table) {
        write("table.csv", table);
        const Outcome outcome = run("scene balls.mha out.toml --labels table.csv");
        EXPECT_NE(outcome.code, 0);
        EXPECT_FALSE(fs::exists(folder_ / "out.toml"));
        return outcome.err;
    };
    EXPECT_NE(refusal("label,name,tissue\n3,a,livver\n").find("table.csv:2: no tissue \"livver\""), std::string::npos);
    EXPECT_NE(refusal("label,name\n3,a\n4,b\n").find("has no \"4\" for \"b\"; it has 3, 8"), std::string::npos);
    EXPECT_NE(refusal("label,name\n3,a\n8,a\n").find("table.csv:3: a second \"a\""), std::string::npos);
    EXPECT_NE(refusal("label,colour\n3,a\n").find("no column \"colour\""), std::string::npos);
    std::ofstream file(folder_ / "measured.mha", std::ios::binary);
    file << "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nElementSpacing = 1 1 1\nDimSize = 20 20 20\n"
            "ElementType = MET_SHORT\nElementDataFile = LOCAL\n";
    for (int k = 0; k < 8000; ++k) file.put(static_cast<char>(k & 255)), file.put(static_cast<char>(k >> 8));
    file.close();
    EXPECT_NE(run("scene measured.mha out.toml").err.find("measured values"), std::string::npos);
}

// Shapes below one named node are a body; USE makes another one of it.
TEST_F(SceneCommand, ShapesOfASceneGraphBecomeBodies) {
    write("world.wrl",
          "#VRML V2.0 utf8\n"
          "DEF organ Transform { translation 0 5 0 children [ Shape { geometry Box { size 2 2 2 } }\n"
          "  Transform { translation 2 0 0 children Shape { geometry Box { size 1 1 1 } } } ] }\n"
          "DEF tool Shape { geometry Sphere { radius 1 } }\n"
          "Transform { translation 0 0 9 children USE tool }\n");
    const auto j = make("world.wrl world.toml --scale 0.01");
    ASSERT_EQ(j["bodies"].size(), 3u);
    // y is up: x, -z, y of the file
    const Vec3d tool = centroid(j, "tool"), organ = centroid(j, "organ") - tool, other = centroid(j, "tool_2") - tool;
    EXPECT_LT((organ - Vec3d(0.02 / 9, 0, 0.05)).norm(), 1e-8) << organ.transpose();
    EXPECT_LT((other - Vec3d(0, -0.09, 0)).norm(), 1e-8) << other.transpose();
    EXPECT_EQ(run("run world.toml --seconds 0.05 --no-render --out out/run").code, 0);
    write("table.csv", "label,name,tissue,motion\ntool_2,probe,,free\norgan,organ,liver,\n");
    const auto chosen = make("world.wrl two.toml --scale 0.01 --labels table.csv");
    ASSERT_EQ(chosen["bodies"].size(), 2u);
    EXPECT_LT((centroid(chosen, "probe") - centroid(chosen, "organ") - (other - organ)).norm(), 1e-8);
}

// The origin of the file, a turn and a path place a body; a body frame stays at its centroid.
TEST_F(SceneCommand, OriginOfTheFile) {
    write("cube.wrl", "#VRML V2.0 utf8\nTransform { translation 3 0 0 children Shape { geometry Box { size 2 2 2 } } }\n");
    write("scene.toml",
          "[[body]]\nname = \"still\"\nfile = \"cube.wrl\"\norigin = \"file\"\nposition = [0, 0, 1]\nrotation = [0, 0, 1, 90]\n"
          "[[body]]\nname = \"moved\"\nfile = \"cube.wrl\"\norigin = \"file\"\nmotion = \"kinematic\"\n"
          "path = [{time = 0, position = [10, 0, 0]}, {time = 0.1, position = [10, 0, 0], rotation = [0, 0, 1, 180]}]\n");
    ASSERT_EQ(run("run scene.toml --seconds 0.2 --no-render --out out").code, 0);
    const auto mean = [&](const std::string& name) {
        Vec3d sum = Vec3d::Zero();
        int count = 0;
        for (const auto& entry : fs::directory_iterator(folder_ / "out/meshes")) {
            if (entry.path().filename().string().find(name + ".obj") == std::string::npos) continue;
            std::ifstream file(entry.path());
            for (std::string word; file >> word;)
                if (Vec3d p; word == "v" && file >> p[0] >> p[1] >> p[2]) sum += p, ++count;
        }
        EXPECT_GT(count, 0);
        return Vec3d(sum / count);
    };
    EXPECT_LT((mean("still") - Vec3d(0, 3, 1)).norm(), 1e-6) << mean("still").transpose();
    EXPECT_LT((mean("moved") - Vec3d(7, 0, 0)).norm(), 1e-6) << mean("moved").transpose();
    write("faulty.toml", "[[body]]\nname = \"a\"\nshape = \"sphere\"\norigin = \"file\"\n");
    EXPECT_NE(run("check faulty.toml").err.find("faulty.toml:1"), std::string::npos);
}

}  // namespace
