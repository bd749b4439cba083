#pragma once
#include <filesystem>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>
namespace trocar {

// Results of runs by what was asked of them, kept in a file with one line each, so that work that was interrupted goes on.
class TrialFile {
 public:
    // Takes over the results of a file that begins with the same identity; another one is begun anew, and a last line that a kill
    // cut off is passed over. An empty path keeps them in memory only.
    TrialFile(std::filesystem::path path, const nlohmann::ordered_json& identity);
    const std::vector<double>* find(const std::string& asked) const;
    // Throws InputError if the file cannot be written.
    void keep(const std::string& asked, const std::vector<double>& result);
    size_t taken_over() const { return taken_over_; }
    size_t made() const { return known_.size() - taken_over_; }

 private:
    std::filesystem::path path_;
    std::map<std::string, std::vector<double>> known_;
    size_t taken_over_ = 0;
};

}  // namespace trocar
