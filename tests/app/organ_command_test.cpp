#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "engine/files/child_process.hpp"
#include "tests/app/run_program.hpp"

// trocar organ from the user's point of view.
namespace {
namespace fs = std::filesystem;
using trocar::Outcome;

class OrganCommand : public testing::Test {
 protected:
    void SetUp() override {
        if (trocar::find_helper_program("trocar-volume-reader").empty()) GTEST_SKIP() << "built without ITK";
        const auto* info = testing::UnitTest::GetInstance()->current_test_info();
        folder_ = fs::path(testing::TempDir()) / (std::string("trocar_organ_") + info->name());
        fs::remove_all(folder_);
        fs::create_directories(folder_);
        // balls of radius 9 (label 3) and 5 (label 8), voxels of 0.5 x 0.5 x 1 mm
        std::ofstream file(folder_ / "balls.mha", std::ios::binary);
        file << "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nElementSpacing = 0.5 0.5 1\n"
                "DimSize = 72 48 24\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
        for (int z = 0; z < 24; ++z) {
            for (int y = 0; y < 48; ++y) {
                for (int x = 0; x < 72; ++x) {
                    const auto within = [&](double cx, double r) { return std::hypot(0.5 * x - cx, 0.5 * y - 12, z - 11.6) < r; };
                    const bool big = within(11, 9), small = within(28, 5);
                    voxels_[0] += big, voxels_[1] += small;
                    file.put(big ? 3 : small ? 8 : 0);
                }
            }
        }
    }
    void TearDown() override {
        if (!folder_.empty()) fs::remove_all(folder_);
    }
    Outcome run(const std::string& arguments) const { return trocar::run_program("organ " + arguments, folder_, folder_); }
    fs::path folder_;
    std::array<int, 2> voxels_{};
};

TEST_F(OrganCommand, OneSurfaceALabelWithItsVolumeAndTetrahedra) {
    const Outcome outcome = run("balls.mha --label 3 8 ball.ply --triangles 600 --tets 1.5 --json");
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    std::istringstream lines(outcome.out);
    std::string line;
    for (int k = 0; k < 2; ++k) {
        ASSERT_TRUE(std::getline(lines, line));
        const nlohmann::json j = nlohmann::json::parse(line);
        const std::string stem = k == 0 ? "ball_3" : "ball_8";
        EXPECT_EQ(j["out"], stem + ".ply");
        EXPECT_EQ(j["voxels"], voxels_[size_t(k)]);
        EXPECT_NEAR(j["voxel_volume_mm3"].get<double>(), voxels_[size_t(k)] * 0.25, 1e-9);
        EXPECT_LT(std::abs(j["volume_error"].get<double>()), 1e-3);
        EXPECT_EQ(j["admitted_as"], "solid");
        EXPECT_LE(j["triangles"], 600);
        EXPECT_EQ(j["stages"].size(), 5u);
        for (const auto& stage : j["stages"]) EXPECT_TRUE(stage["closed"]) << stage;
        EXPECT_GT(j["tets"]["tetrahedra"], 300);
        EXPECT_GT(j["tets"]["min_dihedral"], 10.7);
        EXPECT_EQ(j["tets"]["inverted"], 0);
        EXPECT_EQ(j["tets"]["open_edges"], 0);
        for (const char* ending : {".ply", ".vtu", ".msh"}) EXPECT_TRUE(fs::exists(folder_ / (stem + ending))) << ending;
    }
    EXPECT_FALSE(std::getline(lines, line));
}

// Two balls that overlap, one a layer, as 3D Slicer writes them.
TEST_F(OrganCommand, SegmentsAreChosenByName) {
    std::ofstream file(folder_ / "two.seg.nrrd", std::ios::binary);
    file << "NRRD0004\ntype: uint8\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 30 30 30\nspace directions: none (1,0,0) "
            "(0,1,0) (0,0,1)\nkinds: list domain domain domain\nencoding: raw\nspace origin: (0,0,0)\nSegment0_ID:=S_1\nSegment0_Name:=Big "
            "organ\nSegment0_LabelValue:=1\nSegment0_Layer:=0\nSegment1_ID:=S_2\nSegment1_Name:=Lesion\nSegment1_LabelValue:=1\n"
            "Segment1_Layer:=1\n\n";
    std::array<int, 2> voxels{};
    for (int i = 0; i < 27000; ++i) {
        const double x = i % 30, y = i / 30 % 30, z = i / 900;
        const bool big = std::hypot(x - 14, y - 14, z - 14) < 11, small = std::hypot(x - 20, y - 14, z - 14) < 5;
        voxels[0] += big, voxels[1] += small;
        file.put(char(big)).put(char(small));
    }
    file.close();
    const Outcome both = run("two.seg.nrrd a.obj --segment \"Big organ\" --segment S_2 --json");
    ASSERT_EQ(both.code, 0) << both.err;
    std::istringstream lines(both.out);
    std::string line;
    for (const size_t k : {0u, 1u}) {
        ASSERT_TRUE(std::getline(lines, line));
        EXPECT_EQ(nlohmann::json::parse(line)["voxels"], voxels[k]);
        EXPECT_LT(std::abs(nlohmann::json::parse(line)["volume_error"].get<double>()), 1e-3);
    }
    for (const char* name : {"a_Big_organ.obj", "a_S_2.obj"}) EXPECT_TRUE(fs::exists(folder_ / name)) << name;
    EXPECT_EQ(run("--segment Lesion two.seg.nrrd b.obj").code, 0);
    for (const char* choice : {"", " --label 1", " --segment Bones"}) {
        const Outcome none = run("two.seg.nrrd a.obj" + std::string(choice));
        EXPECT_EQ(none.code, 2) << choice;
        EXPECT_NE(none.err.find("Big organ (label 1 of layer 0, "), std::string::npos) << none.err;
        EXPECT_NE(none.err.find("Lesion (label 1 of layer 1, "), std::string::npos) << none.err;
    }
    EXPECT_NE(run("balls.mha a.obj --segment Lesion").err.find("names no segments"), std::string::npos);
    EXPECT_NE(run("two.seg.nrrd a.obj --segment Lesion --label 1").err.find("exclude each other"), std::string::npos);
    EXPECT_NE(run("balls.mha a.obj --label 3 --frame qform").err.find("only NIfTI has more than one frame"), std::string::npos);
}

TEST_F(OrganCommand, WordsAfterTheLabelsMayBeFiles) {
    EXPECT_EQ(run("--label 3 balls.mha a.stl").code, 0);
    EXPECT_EQ(run("balls.mha --label 3 b.obj --smooth 5").code, 0);
    EXPECT_EQ(run("balls.mha c.obj --label 3,8").code, 0);
    for (const char* name : {"a.stl", "b.obj", "c_3.obj", "c_8.obj"}) EXPECT_TRUE(fs::exists(folder_ / name)) << name;
    EXPECT_EQ(run("balls.mha --label 3").code, 2);
    EXPECT_EQ(run("balls.mha --label 3 a.obj b.obj").code, 2);
}

TEST_F(OrganCommand, WhatIsMissingIsTaught) {
    const Outcome none = run("balls.mha a.obj");
    EXPECT_EQ(none.code, 2);
    EXPECT_NE(none.err.find("its labels are 3 ("), std::string::npos) << none.err;
    const Outcome wrong = run("balls.mha a.obj --label 4");
    EXPECT_EQ(wrong.code, 2);
    EXPECT_NE(wrong.err.find("no voxel has label 4; its labels are 3 ("), std::string::npos) << wrong.err;
    EXPECT_EQ(run("balls.mha a.obj --label 3 --threshold 2").code, 2);
    EXPECT_EQ(run("balls.mha a.obj --threshold nan").code, 2);
    EXPECT_EQ(run("balls.mha a.obj --threshold two").code, 2);
    EXPECT_EQ(run("balls.mha a.xyz --label 3").code, 2);
    EXPECT_EQ(run("absent.mha a.obj --label 3").code, 2);
    EXPECT_EQ(run("balls.mha a.obj --label 3 --tets -1").code, 2);
    const Outcome wide = run("balls.mha a.obj --label 8 --tets 100");
    EXPECT_EQ(wide.code, 2);
    EXPECT_NE(wide.err.find("too wide"), std::string::npos) << wide.err;
    EXPECT_EQ(run("balls.mha a.obj --label 8 --tets 1e-5").code, 2);
}

// Both balls are above 2: the larger piece is kept and the dropped one reported; all pieces on request.
TEST_F(OrganCommand, AThresholdKeepsTheLargestPieceAndSaysWhatWent) {
    const Outcome one = run("balls.mha a.obj --threshold 2 --json");
    ASSERT_EQ(one.code, 0) << one.err;
    EXPECT_NE(one.err.find("smaller pieces that were dropped"), std::string::npos) << one.err;
    const nlohmann::json j = nlohmann::json::parse(one.out);
    EXPECT_EQ(j["voxels_selected"], voxels_[0] + voxels_[1]);
    EXPECT_EQ(j["voxels"], voxels_[0]);
    const Outcome all = run("balls.mha a.obj --threshold 2 --all-pieces --json");
    ASSERT_EQ(all.code, 0) << all.err;
    EXPECT_EQ(nlohmann::json::parse(all.out)["voxels"], voxels_[0] + voxels_[1]);
    EXPECT_TRUE(all.err.empty()) << all.err;
}

}  // namespace
