# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

# The <package>__rosidl_generator_py targets that the PyPI wheels of ROS 2 export carry the include
# directories of the machine that built the wheels, such as /opt/python/cp312-cp312/include, and
# CMake refuses to generate with include directories that do not exist. Those entries are dropped
# here once all packages have been found. Where every directory exists, as with ROS 2 from apt,
# nothing changes.

function(soft_continuum_drop_missing_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  list(FILTER targets INCLUDE REGEX "__rosidl_generator_py$")
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT directories)
      continue()
    endif()
    set(existing "")
    foreach(directory IN LISTS directories)
      # Entries with generator expressions can only be judged later.
      if(directory MATCHES "\\$<" OR EXISTS "${directory}")
        list(APPEND existing "${directory}")
      endif()
    endforeach()
    set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${existing}")
  endforeach()
endfunction()

cmake_language(DEFER CALL soft_continuum_drop_missing_include_directories)
