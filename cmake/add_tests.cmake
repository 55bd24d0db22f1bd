# One ctest per test file, run in the build tree so that the installed package is the one tested.
# test/test_packaging.py is left out: it runs colcon itself (`make test` has it).
find_package(ament_cmake_pytest REQUIRED)

file(GLOB_RECURSE test_files CONFIGURE_DEPENDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR}/test
  ${CMAKE_CURRENT_SOURCE_DIR}/test/test_*.py)
list(REMOVE_ITEM test_files test_packaging.py)

foreach(file IN LISTS test_files)
  get_filename_component(name ${file} NAME_WE)
  ament_add_pytest_test(${name} test/${file}
    APPEND_ENV PYTHONPATH=${CMAKE_INSTALL_PREFIX}/${PYTHON_INSTALL_DIR}
               AMENT_PREFIX_PATH=${CMAKE_INSTALL_PREFIX}
    APPEND_LIBRARY_DIRS ${CMAKE_INSTALL_PREFIX}/lib
    TIMEOUT 1800
  )
endforeach()
