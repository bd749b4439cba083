#pragma once

// Each suite prints its figures; argv[0] is its name. Returns the exit code of the program.
int content_suite(int argc, char** argv);
int contact_suite(int argc, char** argv);
int deform_suite(int argc, char** argv);
int fluid_suite(int argc, char** argv);
int haptics_suite(int argc, char** argv);
int scale_suite(int argc, char** argv);
int scenes_suite(int argc, char** argv);
int report_suite(int argc, char** argv);
