# Installs the headers into a folder of their own and compiles each alone for plain x86-64, as many at a time as there are
# cores: most take the seconds that Eigen takes.
file(REMOVE_RECURSE ${WORK})
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK} OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
set(include ${WORK}/include)
file(GLOB_RECURSE headers RELATIVE ${include} ${include}/*.hpp ${include}/*.h)
if(NOT headers)
  message(FATAL_ERROR "no headers were installed")
endif()
string(JOIN "\n" lines ${headers})
file(WRITE ${WORK}/headers.txt "${lines}\n")
cmake_host_system_information(RESULT cores QUERY NUMBER_OF_LOGICAL_CORES)
set(compile "${CXX} -std=c++20 -march=x86-64 -Wall -Wextra -Werror -fsyntax-only -I${include} -I${include}/trocar -isystem ${EIGEN} -x c++ -")
execute_process(COMMAND xargs -P ${cores} -I{} sh -c "echo '#include <{}>' | ${compile} || { echo 'does not compile alone: {}' >&2; exit 1; }"
                INPUT_FILE ${WORK}/headers.txt RESULT_VARIABLE result)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "headers do not compile alone")
endif()
