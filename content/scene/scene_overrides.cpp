#include <algorithm>
#include <sstream>

#include "content/scene/scene_sections.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

// Parses the value as TOML does; a bare word becomes a string.
void insert_value(toml::table& table, const std::string& key, const std::string& value) {
    const std::optional<toml::table> parsed = parse_toml("v = " + value);
    if (!parsed)
        table.insert_or_assign(key, value);
    else
        parsed->get("v")->visit([&](const auto& node) { table.insert_or_assign(key, node); });
}

toml::table* named_table(toml::table& root, const char* list, const char* name_key, const std::string& name) {
    toml::array* array = root.get_as<toml::array>(list);
    if (!array) return nullptr;
    for (toml::node& node : *array) {
        toml::table* table = node.as_table();
        if (table && table->get(name_key) && table->get(name_key)->value<std::string>() == name) return table;
    }
    return nullptr;
}

// `body.KEY=VALUE`: equivalent to setting the key on every deformable body by name.
void override_deformable_bodies(toml::table& root, const Override& o, const std::string& key) {
    bool any = false;
    toml::array* bodies = root.get_as<toml::array>("body");
    for (size_t i = 0; bodies && i < bodies->size(); ++i) {
        const toml::table* body = bodies->get_as<toml::table>(i);
        const auto word = [body](const char* k) { return body && body->get(k) ? body->get(k)->value<std::string>().value_or("") : ""; };
        const std::string name = word("name");
        if (word("motion") != "deformable" || name.empty() || name == "body") continue;
        apply_override(root, {name + "." + key, o.value});
        any = true;
    }
    if (!any) throw InputError("--set " + o.key + ": the scene has no deformable body");
}

// The parameter that a node refers to by "$name"; null if it does not refer to one.
const toml::node* parameter_of(const std::string& file, const toml::node& node, const toml::table& parameters) {
    const auto text = node.value<std::string_view>();
    if (!node.is_string() || !text->starts_with('$')) return nullptr;
    if (const toml::node* value = parameters.get(text->substr(1))) return value;
    std::vector<std::string> names;
    for (const auto& [key, value] : parameters) names.emplace_back(key.str());
    const std::string guess = nearest(text->substr(1), names);
    throw InputError(location(file, node.source()) + "no parameter \"" + std::string(text->substr(1)) + "\" in [parameters]" +
                     (guess.empty() ? "" : "; did you mean \"" + guess + "\"?"));
}

void fill_in_parameters(const std::string& file, const toml::table& parameters, toml::node& node) {
    if (toml::table* table = node.as_table()) {
        std::vector<std::string> keys;
        for (const auto& [key, value] : *table) keys.emplace_back(key.str());
        for (const std::string& key : keys) {
            toml::node& inner = *table->get(key);
            if (const toml::node* value = parameter_of(file, inner, parameters))
                table->insert_or_assign(key, *value);
            else
                fill_in_parameters(file, parameters, inner);
        }
    } else if (toml::array* array = node.as_array()) {
        for (size_t i = 0; i < array->size(); ++i) {
            toml::node& inner = *array->get(i);
            if (const toml::node* value = parameter_of(file, inner, parameters))
                array->replace(array->cbegin() + static_cast<ptrdiff_t>(i), *value);
            else
                fill_in_parameters(file, parameters, inner);
        }
    }
}

}  // namespace

std::vector<SceneParameter> take_parameters(const std::string& file, toml::table& root) {
    std::vector<SceneParameter> list;
    const toml::node* node = root.get("parameters");
    if (node && !node->is_table()) throw InputError(location(file, node->source()) + "parameters must be a table");
    const toml::table parameters = node ? *node->as_table() : toml::table{};
    for (const auto& [key, value] : parameters) {
        if (!value.is_value())
            throw InputError(location(file, key.source()) + "parameter \"" + std::string(key.str()) +
                             "\" must be a number, a string, true or false");
        std::ostringstream text;
        value.visit([&](const auto& v) { text << v; });
        list.push_back({std::string(key.str()), text.str()});
    }
    root.erase("parameters");
    fill_in_parameters(file, parameters, root);
    return list;
}

void apply_override(toml::table& root, const Override& o) {
    std::vector<std::string> words;
    std::istringstream stream(o.key);
    for (std::string word; std::getline(stream, word, '.');) words.push_back(word);
    if (words.empty() || std::any_of(words.begin(), words.end(), [](const std::string& w) { return w.empty(); }))
        throw InputError("--set " + o.key + "=" + o.value + ": the key is empty");
    if (words.size() > 1 && words[0] == "body" && !named_table(root, "body", "name", "body")) {
        return override_deformable_bodies(root, o, o.key.substr(words[0].size() + 1));
    }
    toml::table* table = &root;
    size_t next = 0;
    if (toml::table* parameters = root["parameters"].as_table(); words.size() == 1 && parameters && parameters->contains(o.key))
        table = parameters;
    const bool named = words[0] == "link" || words[0] == "staple" || words[0] == "cut" || words[0] == "node" || words[0] == "wound" || words[0] == "thread";
    if (words.size() > 2 && (words[0] == "tool" || named)) {
        table = named_table(root, words[0].c_str(), named ? "name" : "body", words[1]);
        if (!table)
            throw InputError("--set " + o.key + ": the scene has no " + words[0] + (named ? "" : " on a body") + " named \"" + words[1] +
                             "\"");
        next = 2;
    } else if (words.size() > 1) {
        if (toml::table* body = named_table(root, "body", "name", words[0])) table = body, next = 1;
    }
    for (; next + 1 < words.size(); ++next) {
        if (!table->contains(words[next])) {
            if (table == &root && words[next] != "contact" && words[next] != "camera" && words[next] != "fluid" &&
                words[next] != "parameters")
                throw InputError("--set " + o.key + ": the scene has no body or table named \"" + words[next] + "\"");
            table->insert(words[next], toml::table{});
        }
        table = table->get_as<toml::table>(words[next]);
        if (!table) throw InputError("--set " + o.key + ": \"" + words[next] + "\" is not a table");
    }
    insert_value(*table, words.back(), o.value);
}

}  // namespace trocar
