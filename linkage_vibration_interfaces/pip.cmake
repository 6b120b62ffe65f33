# Copyright 2026 The linkage_vibration authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

# What only a build with pip needs, which uses the ROS 2 wheels instead of a sourced ROS 2. (The linter
# ament_copyright, which reads this file, does not know the short form of the licence.)

# The wheels share one prefix, but nothing has sourced it.
find_package(Python3 REQUIRED COMPONENTS Interpreter)
execute_process(
  COMMAND "${Python3_EXECUTABLE}" -c
    "import ament_package, pathlib; print(pathlib.Path(ament_package.__file__).parents[4], end='')"
  OUTPUT_VARIABLE wheel_prefix
  COMMAND_ERROR_IS_FATAL ANY)
set(ENV{AMENT_PREFIX_PATH} "${wheel_prefix}")
set(ENV{CMAKE_PREFIX_PATH} "${wheel_prefix}")

# The wheels do not contain the linters.
set(BUILD_TESTING OFF)

# The wheels' Python targets name include folders of the machine that built them; CMake refuses those.
function(drop_missing_include_folders)
  get_property(imported_targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  list(FILTER imported_targets INCLUDE REGEX "__rosidl_generator_py$")
  foreach(target IN LISTS imported_targets)
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    set(present "")
    foreach(folder IN LISTS folders)
      if(EXISTS "${folder}")
        list(APPEND present "${folder}")
      endif()
    endforeach()
    set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${present}")
  endforeach()
endfunction()
cmake_language(DEFER CALL drop_missing_include_folders)
