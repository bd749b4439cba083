#pragma once

// Each suite prints its figures; argv[0] is the suite's name. The exit code of the program is what it returns.
int content_suite(int argc, char** argv);
int contact_suite(int argc, char** argv);
int deform_suite(int argc, char** argv);
int haptics_suite(int argc, char** argv);
int scale_suite(int argc, char** argv);
int report_suite(int argc, char** argv);
