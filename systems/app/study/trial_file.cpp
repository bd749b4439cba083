#include "systems/app/study/trial_file.hpp"

#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>

#include "engine/base/error.hpp"
#include "engine/files/whole_file.hpp"
namespace trocar {
namespace {

std::string line_of(const std::string& asked, const std::vector<double>& result) {
    return nlohmann::ordered_json{{"asked", asked}, {"result", result}}.dump() + "\n";
}

}  // namespace

TrialFile::TrialFile(std::filesystem::path path, const nlohmann::ordered_json& identity) : path_(std::move(path)) {
    if (path_.empty()) return;
    std::ifstream file(path_);
    std::string line;
    if (std::getline(file, line) && nlohmann::ordered_json::parse(line, nullptr, false) == identity) {
        while (std::getline(file, line)) {
            const auto j = nlohmann::ordered_json::parse(line, nullptr, false);
            if (j.is_object()) known_[j["asked"].get<std::string>()] = j["result"].get<std::vector<double>>();
        }
    }
    taken_over_ = known_.size();
    std::string text = identity.dump() + "\n";
    for (const auto& [asked, result] : known_) text += line_of(asked, result);
    write_whole_file(path_, text);
}

const std::vector<double>* TrialFile::find(const std::string& asked) const {
    const auto found = known_.find(asked);
    return found == known_.end() ? nullptr : &found->second;
}

void TrialFile::keep(const std::string& asked, const std::vector<double>& result) {
    known_[asked] = result;
    if (path_.empty()) return;
    std::ofstream file(path_, std::ios::app);
    file << line_of(asked, result);
    if (!file.flush()) throw InputError(path_.string() + ": cannot be written");
}

}  // namespace trocar
