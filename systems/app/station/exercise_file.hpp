#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "systems/app/station/exercise.hpp"
namespace trocar {

// exercise.json: what was recorded, its events and phases; exercise.csv: one line per tool and contact pass.
std::string exercise_json(const Exercise& exercise);
std::string exercise_csv(const Exercise& exercise);

// Throws InputError "file:line: reason". An exercise.csv has its events from the .json beside it, if there is one.
Exercise read_exercise_csv(const std::filesystem::path& file);
// tools.csv of a run: places per contact pass, without turns and organs.
Exercise read_tools_csv(const std::filesystem::path& file);
// Names scene and program of a run by its metrics.json, if it has one.
void read_scene_name(const std::filesystem::path& folder, Exercise& exercise);
// Adds the events "touch" and "release" of a recording that has only the state at each sample.
void add_touches(Exercise& exercise);

// A table of numbers and names, as the files of a run are: the first line names the columns.
struct CsvTable {
    std::string file;
    std::vector<std::string> column;
    std::vector<std::vector<std::string_view>> row;
    std::string text;
    size_t find(std::string_view name) const;  // column.size() if there is none
    // Throws InputError "file:line: reason" if the field is no finite number.
    double number(size_t row, size_t column) const;
};
CsvTable read_csv(const std::filesystem::path& file);

}  // namespace trocar
