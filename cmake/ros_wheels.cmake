# Two things that the ROS 2 wheels on PyPI leave to their user. Neither changes anything on a ROS installation.

# The ament index is searched along AMENT_PREFIX_PATH, which only a ROS installation's setup file sets:
# add the prefix that ament_cmake was found in.
function(find_ament_index)
  cmake_path(SET prefix NORMALIZE "${ament_cmake_DIR}/../../..")
  cmake_path(CONVERT "$ENV{AMENT_PREFIX_PATH}" TO_CMAKE_PATH_LIST known NORMALIZE)
  foreach(path IN LISTS known)
    if(EXISTS "${path}/share/ament_index/resource_index/rosidl_typesupport_c")
      return()
    endif()
  endforeach()
  cmake_path(CONVERT "${known};${prefix}" TO_NATIVE_PATH_LIST paths NORMALIZE)
  set(ENV{AMENT_PREFIX_PATH} "${paths}")
endfunction()

# Imported targets name an include directory of the machine the wheels were built on, and CMake refuses
# targets whose include directories do not exist: drop those.
function(drop_missing_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT directories)
      continue()
    endif()
    set(kept ${directories})
    foreach(directory IN LISTS directories)
      if(IS_ABSOLUTE "${directory}" AND NOT EXISTS "${directory}")
        list(REMOVE_ITEM kept "${directory}")
      endif()
    endforeach()
    if(NOT kept STREQUAL directories)
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${kept}")
      message(STATUS "${target}: dropped include directories that do not exist")
    endif()
  endforeach()
endfunction()
