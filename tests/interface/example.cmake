# Runs the C program of the documents and compares what it prints.
file(READ ${SOURCE}/tests/interface/example.expected wanted)
execute_process(COMMAND ${PROGRAM} OUTPUT_VARIABLE said COMMAND_ERROR_IS_FATAL ANY)
if(NOT said STREQUAL wanted)
  message(FATAL_ERROR "docs/example.c printed\n${said}\nexpected\n${wanted}")
endif()
