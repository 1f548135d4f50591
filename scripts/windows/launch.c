/* python.exe for the python3xx.dll next to it. The DLL's name is given at compile time. */
#include <stdio.h>
#include <windows.h>

int wmain(int count, wchar_t **arguments) {
  HMODULE library = LoadLibraryW(PYTHON_DLL);
  if (!library) {
    fprintf(stderr, "the Python library does not load: error %lu\n", GetLastError());
    return 101;
  }
  int (*run)(int, wchar_t **) = (int (*)(int, wchar_t **))GetProcAddress(library, "Py_Main");
  return run(count, arguments);
}
