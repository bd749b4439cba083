#include <cstdio>
#include <nlohmann/json.hpp>

#include "engine/base/error.hpp"
#include "engine/files/whole_file.hpp"
#include "systems/app/commands/read_run.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/station/comparison.hpp"
#include "systems/app/station/exercise_file.hpp"
#include "systems/app/station/mcap.hpp"
#include "systems/app/station/score.hpp"
namespace trocar {
namespace {

ScoreOptions score_options(const ScoreSettings& s) {
    ScoreOptions options;
    options.idle_speed = s.idle_speed, options.idle_time = s.idle_time;
    for (const std::string& text : s.damage) {
        const size_t equals = text.rfind('=');
        char* end = nullptr;
        const double force = equals == std::string::npos ? 0 : std::strtod(text.c_str() + equals + 1, &end);
        if (equals == 0 || !(force > 0) || *end != '\0')
            throw InputError("--damage " + text + ": write ORGAN=N, for example --damage liver=4.5");
        options.damage[text.substr(0, equals)] = force;
    }
    return options;
}

std::string name_of_run(const std::filesystem::path& run) {
    const std::filesystem::path clean = run.lexically_normal();
    const std::string last = (clean.has_filename() ? clean : clean.parent_path()).filename().string();
    return last.empty() ? run.string() : last;
}

// Runs with the same name get their numbers.
void tell_apart(std::vector<ComparedRun>& runs) {
    std::map<std::string, size_t> count, seen;
    for (const ComparedRun& r : runs) ++count[r.name];
    for (ComparedRun& r : runs)
        if (count[r.name] > 1) r.name += " (" + std::to_string(++seen[r.name]) + ")";
}

}  // namespace

int score_command(const ScoreCommandOptions& o) {
    const ScoreOptions options = score_options(o.settings);
    for (const std::string& run : o.runs) {
        const Exercise e = read_run(run);
        const Score score = score_exercise(e, options);
        // one JSON object a line, so that several runs stay readable for programs
        write_standard_output(
            o.json ? (o.runs.size() > 1 ? nlohmann::ordered_json::parse(score_json(e, score)).dump() + "\n" : score_json(e, score))
                   : score_text(e, score));
    }
    return kDone;
}

int compare_command(const CompareOptions& o) {
    const ScoreOptions options = score_options(o.settings);
    std::vector<CohortLine> lines;
    for (const std::string& run : o.runs) lines.push_back({run, "", "", 0});
    if (!o.cohort.empty())
        for (const CohortLine& line : read_cohort(o.cohort)) lines.push_back(line);
    if (lines.size() < 2) throw InputError("compare: two runs are needed, as arguments or in --cohort");
    std::vector<StageComparison> stages;
    std::error_code error;
    if (lines.size() == 2 && std::filesystem::is_directory(lines[0].run, error) && std::filesystem::is_directory(lines[1].run, error))
        stages = compare_times(lines[0].run, lines[1].run);
    std::vector<ComparedRun> runs;
    std::string without;  // why the first run without tools has no exercise
    for (const CohortLine& line : lines) {
        try {
            ComparedRun run{name_of_run(line.run), read_run(line.run), {}, line.group, line.subject, line.trial};
            run.score = score_exercise(run.exercise, options);
            runs.push_back(std::move(run));
        } catch (const InputError& fault) {
            if (stages.empty()) throw;
            without = fault.what();
        }
    }
    if (runs.size() < lines.size()) runs.clear();  // runs without tools: their times are compared alone
    tell_apart(runs);
    std::vector<Alignment> alignments;
    for (size_t r = 1; r < runs.size(); ++r) alignments.push_back(align_runs(runs[0].exercise, runs[r].exercise));
    const Cohort cohort = summarise_cohort(runs);
    if (!without.empty()) std::fprintf(stderr, "trocar: note: only times are compared: %s\n", without.c_str());
    if (!o.out.empty()) write_whole_file(o.out, comparison_html(runs, cohort, alignments, stages));
    if (o.json)
        write_standard_output(comparison_json(runs, cohort, alignments, stages));
    else if (o.out.empty())
        write_standard_output(comparison_text(runs, alignments, stages));
    else
        write_standard_output("wrote " + o.out.string() + format(": %zu runs, %zu stages\n", runs.size(), stages.size()));
    return kDone;
}

int exercise_command(const ExerciseOptions& o) {
    const Exercise e = read_run(o.run);
    if (!o.mcap.empty()) write_whole_file(o.mcap, exercise_mcap(e));
    if (!o.csv.empty()) write_whole_file(o.csv, exercise_csv(e));
    if (o.mcap.empty() && o.csv.empty()) write_standard_output(exercise_json(e));
    return kDone;
}

}  // namespace trocar
