# Install lib/${PROJECT_NAME}/<name>, what `ros2 run` finds: it calls main() of a Python module.
function(install_executable name module)
  if(CYLCONN_RELOCATABLE)
    set(template executable_relocatable.in)
  else()
    set(template executable.in)
  endif()
  set(script ${CMAKE_CURRENT_BINARY_DIR}/executables/${name})
  configure_file(${CMAKE_CURRENT_SOURCE_DIR}/cmake/${template} ${script} @ONLY
    FILE_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE
  ) # executable already here: --symlink-install links to it
  install(PROGRAMS ${script} DESTINATION lib/${PROJECT_NAME})
endfunction()
